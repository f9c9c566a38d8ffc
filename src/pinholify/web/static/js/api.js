/** Requests to the app. A refused request becomes an Error whose message is a sentence for the user. */

const HEADERS = { "X-Pinholify": "page" };
const GONE = "The app does not respond. Is it still running in the terminal?";

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

/** Send the contents of a file. */
export async function upload(path, blob) {
  return (await send("POST", path, { body: blob, headers: { "Content-Type": "application/octet-stream" } })).json();
}

/** A local address of the picture at `path`. */
export async function picture(path) {
  return URL.createObjectURL(await (await send("GET", path)).blob());
}

/** Download the file at `path`; returns notes on what its format cannot represent. */
export async function download(path) {
  const answer = await send("GET", path);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await answer.blob());
  link.download = /filename="([^"]+)"/.exec(answer.headers.get("content-disposition"))?.[1] ?? "download";
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  return JSON.parse(decodeURIComponent(answer.headers.get("x-notes") ?? "[]"));
}

/** Receive the events of a session until the returned source is closed; the first is a snapshot. */
export function listen(session, onEvent, onLoss) {
  const source = new EventSource(`/api/sessions/${session}/events`);
  source.addEventListener("message", (event) => onEvent(JSON.parse(event.data)));
  source.addEventListener("error", () => onLoss(source.readyState === EventSource.CLOSED));
  return source;
}
