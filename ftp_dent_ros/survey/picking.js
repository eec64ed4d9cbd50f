'use strict';
// Places of the survey picked in its pictures, and the file of reference points made of them.
const places = JSON.parse(document.getElementById('places').textContent);
const picks = [];
const byId = (id) => document.getElementById(id);

const decoded = (text) =>
  new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
const height = decoded(places.height), findable = decoded(places.findable);

// Linearly between the middles of the measured cells around a place.
function heightAt(x, y) {
  const u = (x - places.low[0]) / places.side - 0.5, v = (y - places.low[1]) / places.side - 0.5;
  let sum = 0, weights = 0;
  for (const [column, row] of [[0, 0], [1, 0], [0, 1], [1, 1]]) {
    const c = Math.floor(u) + column, r = Math.floor(v) + row;
    if (c < 0 || r < 0 || c >= places.columns || r >= places.rows) continue;
    const value = height[r * places.columns + c];
    const weight = (1 - Math.abs(u - c)) * (1 - Math.abs(v - r));
    if (Number.isNaN(value) || weight <= 0) continue;
    sum += weight * value; weights += weight;
  }
  return weights > 0 ? sum / weights : NaN;
}

function pointAt(x, y) {
  const up = heightAt(x, y);
  if (Number.isNaN(up)) return null;
  // As of survey.unrolled: by the tip of the cone, which may be ever so far off.
  const { radius, taper } = places, cosine = Math.cos(taper), sine = Math.sin(taper) || 1e-12;
  const tip = sine / cosine / radius;
  const line = (2 * x - tip * (x * x + y * y)) / (1 + Math.hypot(1 - tip * x, tip * y));
  const angle = Math.atan2(tip * y, 1 - tip * x) / sine;
  const from = radius * cosine - line * sine + up * cosine, along = radius * sine + line * cosine + up * sine;
  const out = from * Math.cos(angle), aside = from * Math.sin(angle);
  return [0, 1, 2].map((i) => places.origin[i] + (along * cosine - out * sine) * places.axis[i]
    + (along * sine + out * cosine - radius) * places.normal[i] + aside * places.around[i]);
}

// x and y on the unrolled skin of a pointer on a picture.
function placeOf(event, svg) {
  const box = svg.getBoundingClientRect(), size = svg.viewBox.baseVal;
  const u = size.x + (event.clientX - box.left) * size.width / box.width;
  const v = (event.clientY - box.top) * size.height / box.height;
  return { u, v, x: places.low[0] + u * places.pixel, y: places.low[1] + (size.height - v) * places.pixel };
}

const shownAt = (point) => point.map((value) => value.toFixed(4)).join(', ');

function tell({ x, y }) {
  const point = pointAt(x, y);
  const cell = Math.floor((y - places.low[1]) / places.side) * places.columns + Math.floor((x - places.low[0]) / places.side);
  const depth = findable[cell];
  byId('here').textContent = `Unrolled x ${x.toFixed(3)} m, y ${y.toFixed(3)} m: `
    + (point ? `at ${shownAt(point)} m` : 'not measured')
    + (depth >= 0 ? `; a dent would have been found there from ${(1000 * depth).toFixed(3)} mm.` : '.');
}

function mark() {
  for (const svg of document.querySelectorAll('.skin svg')) {
    svg.querySelectorAll('.pick, .pick-name').forEach((each) => each.remove());
    const size = svg.viewBox.baseVal.width;
    picks.forEach((pick, index) => {
      const make = (tag, set) => {
        const element = document.createElementNS('http://www.w3.org/2000/svg', tag);
        for (const [name, value] of Object.entries(set)) element.setAttribute(name, value);
        svg.append(element);
        return element;
      };
      make('circle', { class: 'pick', cx: pick.u, cy: pick.v, r: size / 110 });
      make('text', { class: 'pick-name', x: pick.u + size / 90, y: pick.v, 'font-size': size / 55, 'stroke-width': size / 250 })
        .textContent = `P${index + 1}`;
    });
  }
}

function show() {
  mark();
  const body = byId('picks');
  body.replaceChildren();
  picks.forEach((pick, index) => {
    const row = body.insertRow();
    const field = (name, value, keep) => {
      const input = document.createElement('input');
      input.className = name; input.value = value; input.setAttribute('aria-label', `${name} of point ${index + 1}`);
      input.addEventListener('input', () => { keep(input.value); write(); });
      const cell = row.insertCell(); cell.append(input);
      return cell;
    };
    field('name', pick.name, (value) => { pick.name = value; }).className = 'left';
    row.insertCell().textContent = shownAt(pick.point);
    ['station', 'buttock', 'water'].forEach((name, i) => field(name, pick.at[i], (value) => { pick.at[i] = value; }));
    const away = document.createElement('button');
    away.type = 'button'; away.textContent = 'Remove';
    away.addEventListener('click', () => { picks.splice(index, 1); show(); });
    const last = row.insertCell(); last.className = 'controls'; last.append(away);
  });
  write();
}

function text() {
  const lines = [`# Reference points of the survey ${JSON.stringify(places.name)}: map in metres, at in millimetres.`, 'unit: mm', 'points:'];
  for (const pick of picks) {
    const at = pick.at.map((value) => (value.trim() === '' ? NaN : Number(value)));
    const whole = at.every(Number.isFinite);
    const shown = whole ? at.join(', ') : 'station, buttock line, water line';
    lines.push(`${whole ? '' : '# '}  - {name: ${JSON.stringify(pick.name)}, map: [${shownAt(pick.point)}], at: [${shown}]}`);
  }
  return `${lines.join('\n')}\n`;
}

function write() {
  byId('file').value = text();
  const whole = picks.filter((pick) => pick.at.every((value) => value.trim() !== '' && Number.isFinite(Number(value)))).length;
  byId('lacking').textContent = whole < 3 ? `${whole} of 3 points have their coordinates.` : `${whole} points.`;
}

for (const svg of document.querySelectorAll('.skin svg')) {
  svg.addEventListener('pointermove', (event) => tell(placeOf(event, svg)));
  svg.addEventListener('click', (event) => {
    const place = placeOf(event, svg), point = pointAt(place.x, place.y);
    tell(place);
    if (!point) return;
    picks.push({ ...place, point, name: `point ${picks.length + 1}`, at: ['', '', ''] });
    show();
  });
}

byId('save').addEventListener('click', () => {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([text()], { type: 'text/yaml' }));
  link.download = 'points.yaml';
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
});
write();
