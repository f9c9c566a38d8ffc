// Rotates the boards and lines of sight by dragging, keyboard or buttons. Orthographic; x right, y down, z forward.
"use strict";
for (const scene of document.querySelectorAll(".scene")) {
  const data = JSON.parse(scene.querySelector("script").textContent);
  const canvas = scene.querySelector("canvas");
  const pointed = scene.querySelector(".pointed");
  const context = canvas.getContext("2d");
  const home = { yaw: data.yaw, pitch: data.pitch, zoom: 1 };
  const view = { ...home, lines: true };
  let under = -1;

  function turned(point) {
    const [x, y, z] = point.map((value, axis) => value - data.middle[axis]);
    const across = Math.cos(view.yaw) * x - Math.sin(view.yaw) * z;
    const depth = Math.sin(view.yaw) * x + Math.cos(view.yaw) * z;
    return [across, Math.cos(view.pitch) * y - Math.sin(view.pitch) * depth,
      Math.sin(view.pitch) * y + Math.cos(view.pitch) * depth];
  }

  function place(point) {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    const scale = data.fill * Math.min(width / data.reach[0], height / data.reach[1]) * view.zoom;
    const [across, down, depth] = turned(point);
    return [width / 2 + scale * across, height / 2 + scale * down, depth];
  }

  function trace(points, closed) {
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    if (closed) context.closePath();
  }

  function placedBoards() {
    const placed = data.boards.map((corners, index) => {
      const points = corners.map(place);
      return { index, points, depth: points.reduce((sum, point) => sum + point[2], 0) };
    });
    return placed.sort((a, b) => b.depth - a.depth);
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    if (view.lines) {
      context.lineWidth = 0.7;
      context.strokeStyle = colour("sight");
      for (const line of data.lines) { trace(line.map(place), false); context.stroke(); }
    }
    context.lineJoin = "round";
    for (const { index, points } of placedBoards()) {
      trace(points, true);
      context.fillStyle = colour("board");
      context.fill();
      context.lineWidth = index === under ? 3 : 1;
      context.strokeStyle = colour("accent");
      context.stroke();
    }
    context.lineWidth = 1.5;
    context.strokeStyle = colour("ink");
    for (const corner of data.frustum) { trace([[0, 0, 0], corner].map(place), false); context.stroke(); }
    trace(data.frustum.map(place), true);
    context.stroke();
    const [x, y] = place([0, 0, 0]);
    context.fillStyle = colour("warn");
    context.beginPath();
    context.arc(x, y, 3.5, 0, 2 * Math.PI);
    context.fill();
  }

  function turn(across, down) {
    view.yaw -= across;
    view.pitch = Math.max(-1.57, Math.min(1.57, view.pitch - down));
    draw();
  }

  function zoom(factor) {
    view.zoom = Math.max(0.3, Math.min(50, view.zoom * factor));
    draw();
  }

  function point(event) {
    const box = canvas.getBoundingClientRect();
    const at = [event.clientX - box.left, event.clientY - box.top];
    const hit = placedBoards().reverse().find(({ points }) => {
      trace(points, true);
      context.setTransform(1, 0, 0, 1, 0, 0);
      return context.isPointInPath(...at);
    });
    name(hit ? hit.index : -1);
  }

  function name(board) {
    if (board === under) return;
    under = board;
    pointed.textContent = board < 0 ? "" : data.names[board];
    draw();
  }

  const actions = {
    left: () => turn(0.15, 0), right: () => turn(-0.15, 0), up: () => turn(0, 0.15), down: () => turn(0, -0.15),
    in: () => zoom(1.3), out: () => zoom(1 / 1.3), reset: () => { Object.assign(view, home); draw(); },
    lines: (button) => {
      view.lines = !view.lines;
      button.setAttribute("aria-pressed", view.lines);
      draw();
    },
  };
  const keys = { ArrowLeft: "left", ArrowRight: "right", ArrowUp: "up", ArrowDown: "down", "+": "in", "=": "in",
    "-": "out", "0": "reset" };

  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) turn(-0.008 * event.movementX, -0.008 * event.movementY);
    else point(event);
  });
  canvas.addEventListener("pointerleave", () => name(-1));
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return; // the page scrolls unless the scene has focus
    event.preventDefault();
    zoom(Math.exp(-0.002 * event.deltaY));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
    event.preventDefault();
    actions[keys[event.key]]();
  });
  for (const button of scene.querySelectorAll("button")) {
    button.addEventListener("click", () => actions[button.dataset.does](button));
  }

  scene.querySelector(".still").style.display = "none";
  for (const part of scene.querySelectorAll("[hidden]")) part.hidden = false;
  new ResizeObserver(draw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}
