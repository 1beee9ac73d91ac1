/* The robot along the sweep in 3-D; its data are JSON in this page. */
(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const figure = document.getElementById("scene");
  if (figure === null) return;
  const canvas = figure.querySelector("canvas");
  const pen = canvas.getContext("2d");
  if (data === null || pen === null) return;
  figure.hidden = false;
  document.querySelector(".still").hidden = true;
  const slider = document.getElementById("scene-load");
  const output = figure.querySelector("output");
  const COLOURS = { cc_from_force: "red", cc_from_lengths: "blue" };
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const view = { azimuth: -1.1, height: 0.35, zoom: 1 };
  let load = data.load.length - 1;

  // -- projection: along the line of sight, z up ---------------------------------------------

  let axes = [];
  let centre = [0, 0, 0];
  let scale = 1;
  function aim() {
    const [ca, sa, ch, sh] = [Math.cos(view.azimuth), Math.sin(view.azimuth), Math.cos(view.height), Math.sin(view.height)];
    axes = [[-sa, ca, 0], [-ca * sh, -sa * sh, ch], [ca * ch, sa * ch, sh]];
    centre = [0, 0, 0.45 * data.length];
    scale = (view.zoom * Math.min(canvas.clientWidth, canvas.clientHeight)) / (1.6 * data.length);
  }
  const depth = (p) => axes[2].reduce((sum, a, q) => sum + a * (p[q] - centre[q]), 0);
  const place = (p) => {
    const along = (axis) => axis.reduce((sum, a, q) => sum + a * (p[q] - centre[q]), 0);
    return [canvas.clientWidth / 2 + scale * along(axes[0]), canvas.clientHeight / 2 - scale * along(axes[1])];
  };

  // -- shapes: what is farther away is drawn first ---------------------------------------------

  /** Points of a backbone through disks: cubic curves along the normals of both. */
  function curve(disks) {
    const points = [[0, 0, 0]];
    let [p, n, station] = [[0, 0, 0], [0, 0, 1], 0];
    disks.forEach((d, k) => {
      const [q, m] = [d.slice(0, 3), [d[5], d[8], d[11]]];
      const long = data.station[k] - station;
      for (let i = 1; i <= 6; i++) {
        const t = i / 6;
        const [a, b, c, e] = [2 * t ** 3 - 3 * t ** 2 + 1, t ** 3 - 2 * t ** 2 + t, -2 * t ** 3 + 3 * t ** 2, t ** 3 - t ** 2];
        points.push(p.map((x, r) => a * x + b * long * n[r] + c * q[r] + e * long * m[r]));
      }
      [p, n, station] = [q, m, data.station[k]];
    });
    return points;
  }
  function ring(d, radius) {
    return Array.from({ length: 33 }, (_, i) => {
      const [c, s] = [radius * Math.cos((i * Math.PI) / 16), radius * Math.sin((i * Math.PI) / 16)];
      return [0, 1, 2].map((r) => d[r] + c * d[3 + 3 * r] + s * d[4 + 3 * r]);
    });
  }
  function shapes() {
    const found = [];
    const line = (points, style, width, alpha = 1) => {
      for (let i = 0; i + 1 < points.length; i++) {
        const two = points.slice(i, i + 2);
        found.push({ points: two, at: (depth(two[0]) + depth(two[1])) / 2, style, width, alpha });
      }
    };
    const step = data.length / 8;
    for (let i = -4; i <= 4; i++) {
      line([[i * step, -4 * step, 0], [i * step, 4 * step, 0]], colour("grid"), 1);
      line([[-4 * step, i * step, 0], [4 * step, i * step, 0]], colour("grid"), 1);
    }
    const disks = data.disks[load];
    line(curve(disks), colour("ink"), 4);
    const plates = [[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1], ...disks];
    plates.forEach((d, k) => {
      const radius = k === 0 ? 1.15 * data.radius[0] : data.radius[k - 1];
      found.push({ points: ring(d, radius), at: depth(d), style: colour("muted"), width: 1, alpha: 0.9, fill: 0.25 });
    });
    for (const path of data.tendons[load] ?? []) line(path, colour("muted"), 1);
    for (const model of data.models) {
      const points = model.backbone[load];
      if (points === null) continue;
      line(points, colour(COLOURS[model.name]), 5, 0.55);
      found.push({ dot: points[points.length - 1], at: depth(points[points.length - 1]) + 1, style: colour(COLOURS[model.name]), size: 5 });
    }
    for (const point of data.measured) found.push({ dot: point, at: depth(point), style: colour("green"), size: 2.5 });
    return found.sort((a, b) => a.at - b.at);
  }
  function draw() {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    aim();
    pen.lineCap = "round";
    for (const shape of shapes()) {
      pen.globalAlpha = shape.alpha ?? 1;
      pen.fillStyle = pen.strokeStyle = shape.style;
      pen.beginPath();
      if (shape.dot) {
        pen.arc(...place(shape.dot), shape.size, 0, 7);
        pen.fill();
        continue;
      }
      shape.points.map(place).forEach(([x, y], i) => (i === 0 ? pen.moveTo(x, y) : pen.lineTo(x, y)));
      if (shape.fill) {
        pen.globalAlpha = shape.fill;
        pen.fill();
        pen.globalAlpha = shape.alpha;
      }
      pen.lineWidth = shape.width;
      pen.stroke();
    }
    // key and bar of scale
    pen.globalAlpha = 1;
    pen.font = "13px system-ui, sans-serif";
    const key = [["rod", "ink"], ...data.models.map((m) => [m.label, COLOURS[m.name]])];
    if (data.measured.length) key.push([data.label, "green"]);
    key.forEach(([text, name], i) => {
      pen.fillStyle = colour(name);
      pen.fillRect(10, 12 + 18 * i, 14, 4);
      pen.fillStyle = colour("ink");
      pen.fillText(text, 30, 19 + 18 * i);
    });
    const power = 10 ** Math.floor(Math.log10(data.length / 3));
    const bar = power * [5, 2, 1].find((m) => m * power <= data.length / 3);
    pen.fillStyle = colour("ink");
    pen.fillRect(10, canvas.clientHeight - 14, scale * bar, 3);
    pen.fillText(`${Number(bar.toPrecision(3))} mm`, 10, canvas.clientHeight - 20);
  }

  // -- the load ------------------------------------------------------------------------------

  function show() {
    const parts = data.models.map((model) => {
      const error = model.error[load];
      return `${model.label}: ${error === null ? "no arc" : `${Number(error.toPrecision(3))} mm${error > data.tolerance ? ", beyond the tolerance" : ""}`}`;
    });
    output.textContent = `${Number(data.load[load].toPrecision(4))} N. Tip error of ${parts.join("; ")}.`;
    slider.setAttribute("aria-valuetext", output.textContent);
    draw();
  }
  slider.max = String(load);
  slider.value = String(load);
  slider.addEventListener("input", () => {
    load = Number(slider.value);
    show();
  });

  // -- turning ---------------------------------------------------------------------------------

  const turn = (azimuth, height, zoom = 1) => {
    view.azimuth += azimuth;
    view.height = Math.min(1.57, Math.max(-1.57, view.height + height));
    view.zoom = Math.min(20, Math.max(0.2, view.zoom * zoom));
    draw();
  };
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) turn(-event.movementX / 120, event.movementY / 120);
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 1.1], "-": [0, 0, 1 / 1.1] }[event.key];
    if (!by) return;
    event.preventDefault();
    turn(...by);
  });
  new ResizeObserver(draw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  show();
})();
