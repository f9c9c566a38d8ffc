// Rotates the lines of sight in the element "pinhole-lines" (JSON), with one canvas per data set.
// Orthographic, one scale on all axes. Dragging and arrow keys rotate, wheel and +/- zoom, a double click resets.
"use strict";
(() => {
  const panels = JSON.parse(document.getElementById("pinhole-lines").textContent);
  const home = { yaw: -0.6, pitch: 0.3, zoom: 1 };

  function turned([x, y, z], view) {
    const c = Math.cos(view.yaw), s = Math.sin(view.yaw);
    const p = Math.cos(view.pitch), q = Math.sin(view.pitch);
    const across = c * x + s * z, depth = -s * x + c * z;
    return [depth, p * y + q * across];
  }

  function start(canvas, panel) {
    const context = canvas.getContext("2d");
    const view = { ...home };
    const points = panel.segments.flat();
    const middle = [0, 1, 2].map((axis) => {
      const along = points.map((point) => point[axis]);
      return (Math.min(...along) + Math.max(...along)) / 2;
    });
    const reach = Math.max(...points.map((point) => Math.hypot(...point.map((x, axis) => x - middle[axis]))));
    const note = canvas.parentElement.querySelector(".zoom");

    function draw() {
      const ratio = window.devicePixelRatio || 1;
      const width = canvas.clientWidth, height = canvas.clientHeight;
      canvas.width = width * ratio;
      canvas.height = height * ratio;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      const unit = 0.7 * Math.min(width, height) / reach;
      const scale = unit * view.zoom;
      const [across, down] = turned(middle, view);
      const origin = [width / 2 - unit * across, height / 2 - unit * down];
      const place = (point) => {
        const [a, b] = turned(point, view);
        return [origin[0] + scale * a, origin[1] + scale * b];
      };
      const style = getComputedStyle(canvas);
      context.lineWidth = 0.6;
      context.strokeStyle = style.getPropertyValue("--line");
      context.beginPath();
      for (const [from, to] of panel.segments) {
        context.moveTo(...place(from));
        context.lineTo(...place(to));
      }
      context.stroke();
      context.fillStyle = style.getPropertyValue("--ink");
      for (const [, to] of panel.segments) {
        const [a, b] = place(to);
        context.fillRect(a - 1, b - 1, 2, 2);
      }
      context.fillStyle = style.getPropertyValue("--dot");
      context.beginPath();
      context.arc(...origin, 3, 0, 2 * Math.PI);
      context.fill();
      note.textContent = `${(width / scale).toPrecision(2)} f across`;
    }

    function turn(across, down) {
      view.yaw += across;
      view.pitch = Math.max(-1.57, Math.min(1.57, view.pitch + down));
      draw();
    }

    function zoom(factor) {
      view.zoom = Math.max(0.3, Math.min(1e6, view.zoom * factor));
      draw();
    }

    const keys = {
      ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
      ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
      "+": () => zoom(1.5), "-": () => zoom(1 / 1.5),
    };
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) turn(0.008 * event.movementX, 0.008 * event.movementY);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(Math.exp(-0.002 * event.deltaY));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { Object.assign(view, home); draw(); });
    canvas.addEventListener("keydown", (event) => {
      if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
    });
    new ResizeObserver(draw).observe(canvas);
  }

  document.querySelectorAll("canvas.pencil").forEach((canvas, i) => start(canvas, panels[i]));
})();
