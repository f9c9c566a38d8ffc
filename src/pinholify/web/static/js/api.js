/** Talking to the app. Whatever is refused becomes an Error whose message is a sentence for people. */

const HEADERS = { "X-Pinholify": "page" };
const GONE = "The app does not answer; is it still running in the terminal?";

async function send(method, path, options = {}) {
  let answer;
  try {
    answer = await fetch(`/api${path}`, { method, ...options, headers: { ...HEADERS, ...options.headers } });
  } catch {
    throw new Error(GONE);
  }
  if (answer.ok && !answer.headers.has("X-Refused")) return answer;
  const { error } = await answer.json().catch(() => ({}));
  throw new Error(error ?? `The app answered with status ${answer.status}.`);
}

export const get = async (path) => (await send("GET", path)).json();
export const remove = (path) => send("DELETE", path);

export async function post(path, data = {}) {
  return (await send("POST", path, asJson(data))).json();
}

export const change = (path, data) => send("PATCH", path, asJson(data));

const asJson = (data) => ({ body: JSON.stringify(data), headers: { "Content-Type": "application/json" } });

/** Send a file or a picture as it is. */
export async function upload(path, blob) {
  return (await send("POST", path, { body: blob, headers: { "Content-Type": "application/octet-stream" } })).json();
}

/** An address within the browser of the picture that the app makes at `path`. */
export async function picture(path) {
  return URL.createObjectURL(await (await send("GET", path)).blob());
}

/** Have the browser keep what the app makes at `path`; gives sentences about what that cannot hold. */
export async function download(path) {
  const answer = await send("GET", path);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition"))?.[1] ?? "download";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  return JSON.parse(decodeURIComponent(answer.headers.get("x-notes") ?? "[]"));
}

/** Hear all that happens in a session until the returned source is closed; the first event is all of it. */
export function listen(session, heard, lost) {
  const source = new EventSource(`/api/sessions/${session}/events`);
  source.addEventListener("message", (event) => heard(JSON.parse(event.data)));
  source.addEventListener("error", () => lost(source.readyState === EventSource.CLOSED));
  return source;
}
