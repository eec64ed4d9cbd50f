'use strict';
// Two drawings: points in three dimensions, and the map.

function colourOf(value, range) {
  const t = Math.max(-1, Math.min(1, value / range));
  const stops = [[20, 80, 180], [158, 195, 234], [232, 232, 232], [242, 164, 140], [180, 0, 30]];
  const at = (t + 1) * 2, low = Math.min(3, Math.floor(at)), part = at - low;
  return stops[low].map((from, i) => from + part * (stops[low + 1][i] - from));
}

class CloudView {
  constructor(canvas) {
    this.canvas = canvas;
    this.yaw = 0.35; this.pitch = -0.3; this.zoom = 1; this.range = 0.5;
    this.values = new Float32Array(0);
    let last = null;
    canvas.addEventListener('pointerdown', (event) => {
      last = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!last) return;
      this.yaw += (event.clientX - last[0]) / 200;
      this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch - (event.clientY - last[1]) / 200));
      last = [event.clientX, event.clientY];
      this.draw();
    });
    for (const name of ['pointerup', 'pointercancel']) canvas.addEventListener(name, () => { last = null; });
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoom = Math.max(0.4, Math.min(8, this.zoom * Math.exp(-event.deltaY / 600)));
      this.draw();
    }, { passive: false });
  }

  show(values) {
    this.values = values;
    let size = 0;
    const off = [];
    for (let i = 0; i < values.length; i += 4) {
      size = Math.max(size, Math.hypot(values[i], values[i + 1], values[i + 2]));
      if (i % 40 === 0) off.push(Math.abs(values[i + 3]));
    }
    off.sort((a, b) => a - b);
    this.size = size || 1;
    // The scale keeps out the rarest points: a two-hundredth.
    this.range = Math.max(0.02, off[Math.floor(0.995 * off.length)] || 0);
    this.draw();
  }

  draw() {
    const { width, height } = this.canvas;
    const context = this.canvas.getContext('2d');
    const image = context.createImageData(width, height);
    const pixels = image.data, depth = new Float32Array(width * height).fill(Infinity);
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const scale = this.zoom * 0.62 * height / this.size;
    const dot = Math.max(2, Math.round(this.zoom * width / 200));
    const v = this.values;
    for (let i = 0; i < v.length; i += 4) {
      const x = cy * v[i] + sy * v[i + 2], z = cy * v[i + 2] - sy * v[i];
      const y = cp * v[i + 1] - sp * z, far = cp * z + sp * v[i + 1];
      const left = Math.round(width / 2 + scale * x), top = Math.round(height / 2 + scale * y);
      const colour = colourOf(v[i + 3], this.range);
      for (let row = top; row < top + dot; row++) {
        if (row < 0 || row >= height) continue;
        for (let column = left; column < left + dot; column++) {
          if (column < 0 || column >= width) continue;
          const at = row * width + column;
          if (far >= depth[at]) continue;
          depth[at] = far;
          pixels.set([colour[0], colour[1], colour[2], 255], 4 * at);
        }
      }
    }
    context.putImageData(image, 0, 0);
  }
}

class MapView {
  constructor(canvas) { this.canvas = canvas; this.axes = [0, 1]; this.state = { path: [], areas: [], gaps: [], dents: [] }; }

  show(state) { this.state = state; this.draw(); }

  draw() {
    const { width, height } = this.canvas, { path, areas, gaps, dents } = this.state;
    const context = this.canvas.getContext('2d');
    context.clearRect(0, 0, width, height);
    const [a, b] = this.axes;
    const places = [...path, ...areas.flat(), ...dents.map((dent) => dent.place)].filter((p) => !p.includes(null));
    if (!places.length) { this.text(context, 'no place yet', 20, 40); return; }
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (const place of places) {
      [a, b].forEach((axis, i) => { low[i] = Math.min(low[i], place[axis]); high[i] = Math.max(high[i], place[axis]); });
    }
    const span = Math.max(high[0] - low[0], (high[1] - low[1]) * width / height, 0.5);
    const scale = 0.84 * width / span;
    const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    const at = (p) => [width / 2 + scale * (p[a] - middle[0]), height / 2 - scale * (p[b] - middle[1])];
    context.fillStyle = 'rgba(0, 110, 60, .16)';
    for (const area of areas) { this.line(context, area.map(at)); context.closePath(); context.fill(); }
    context.fillStyle = '#d8232a';
    for (const gap of gaps) { this.line(context, gap.map(at)); context.closePath(); context.fill(); }
    context.strokeStyle = '#003d7a'; context.lineWidth = 4;
    this.line(context, path.map(at)); context.stroke();
    if (path.length) {
      const [x, y] = at(path[path.length - 1]);
      context.fillStyle = '#003d7a'; context.beginPath(); context.arc(x, y, 11, 0, 7); context.fill();
    }
    for (const dent of dents) {
      if (dent.place.includes(null)) continue;
      const [x, y] = at(dent.place);
      context.fillStyle = dent.kind === 'bump' ? '#1450b4' : '#b4001e';
      context.beginPath(); context.arc(x, y, 7, 0, 7); context.fill();
      this.text(context, String(dent.number), x + 9, y - 7);
    }
    const bar = 10 ** Math.floor(Math.log10(span / 3));
    context.fillStyle = '#000'; context.fillRect(20, height - 24, bar * scale, 6);
    this.text(context, `${bar >= 1 ? bar : bar.toFixed(2)} m`, 20, height - 34);
  }

  line(context, places) {
    context.beginPath();
    places.forEach(([x, y], i) => { if (i) context.lineTo(x, y); else context.moveTo(x, y); });
  }

  text(context, text, x, y) {
    context.font = 'bold 24px sans-serif'; context.lineWidth = 5; context.strokeStyle = '#fff'; context.fillStyle = '#000';
    context.strokeText(text, x, y); context.fillText(text, x, y);
  }
}
