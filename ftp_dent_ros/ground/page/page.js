'use strict';
const byId = (id) => document.getElementById(id);
const cloudView = new CloudView(byId('cloud'));
const mapView = new MapView(byId('map'));
const LEVELS = ['good', 'wait', 'bad', 'bad'];
let shown = {};

function put(parent, tag, text, name) {
  const element = document.createElement(tag);
  if (text !== undefined) element.textContent = text;
  if (name) element.className = name;
  parent.append(element);
  return element;
}

function showLink(link) {
  byId('link').textContent = link.text;
  byId('link').className = `chip ${LEVELS[link.level]}`;
  byId('rate').textContent = `${link.rate} kbit/s`;
}

function showStatuses(statuses) {
  const open = new Set([...document.querySelectorAll('details[open]')].map((each) => each.dataset.name));
  const box = byId('statuses');
  box.replaceChildren();
  for (const status of statuses) {
    const details = put(box, 'details');
    details.dataset.name = status.name;
    details.open = open.has(status.name);
    const summary = put(details, 'summary');
    put(summary, 'strong', ['works', 'warning', 'error', 'stale'][status.level] || '?', `chip ${LEVELS[status.level]}`);
    summary.append(` ${status.name}: ${status.message}`);
    const list = put(details, 'dl');
    for (const [key, value] of Object.entries(status.values)) { put(list, 'dt', key); put(list, 'dd', value); }
    if (status.name.endsWith('downlink')) {
      byId('recording').textContent = status.values.recording || '';
      const kept = status.values['waiting (MB)'];
      byId('kept').textContent = kept ? `${kept} MB still up there` : '';
    }
  }
}

function showDents(dents) {
  byId('count').textContent = `${dents.filter((dent) => dent.kind === 'dent').length} in the list`;
  const body = byId('dents');
  body.replaceChildren();
  for (const dent of [...dents].sort((one, other) => (other.depth_mm || 0) - (one.depth_mm || 0))) {
    const row = put(body, 'tr');
    put(row, 'td', dent.number);
    put(row, 'td', dent.kind);
    for (const name of ['depth', 'length', 'width']) {
      const digits = name === 'depth' ? 3 : 1;
      const value = dent[`${name}_mm`], half = dent[`${name}_interval_mm`];
      const cell = put(row, 'td', value === null ? 'unknown' : value.toFixed(digits));
      if (value !== null && half !== null) put(cell, 'small', `± ${half.toFixed(digits)}`);
    }
    put(row, 'td', dent.sightings);
  }
}

function showPicture(picture) {
  const image = byId('picture'), svg = byId('outlines');
  if (!picture) return;
  if (picture.stamp !== shown.picture) {
    shown.picture = picture.stamp;
    image.src = `picture?${picture.stamp}`;
    image.hidden = false;
    byId('picture-age').textContent = new Date(Number(picture.stamp.slice(0, -6))).toLocaleTimeString();
  }
  svg.setAttribute('viewBox', `0 0 ${picture.width} ${picture.height}`);
  svg.replaceChildren();
  for (const outline of picture.outlines) {
    const make = (tag) => document.createElementNS('http://www.w3.org/2000/svg', tag);
    const shape = make('polygon');
    shape.setAttribute('points', outline.points.map((point) => point.join(',')).join(' '));
    shape.setAttribute('class', outline.kind);
    const label = make('text');
    label.setAttribute('x', Math.max(...outline.points.map((point) => point[0])));
    label.setAttribute('y', Math.min(...outline.points.map((point) => point[1])));
    label.setAttribute('font-size', picture.height / 22);
    label.textContent = outline.number;
    svg.append(shape, label);
  }
}

async function showCloud(stamp) {
  if (!stamp || stamp === shown.cloud) return;
  shown.cloud = stamp;
  const answer = await fetch(`cloud?${stamp}`);
  cloudView.show(new Float32Array(await answer.arrayBuffer()));
  byId('range').textContent = byId('range2').textContent = cloudView.range.toFixed(2);
}

function show(news) {
  showLink(news.link);
  if (news.version === undefined) return;
  showStatuses(news.statuses);
  showDents(news.dents);
  showPicture(news.picture);
  mapView.show(news);
  showCloud(news.cloud).catch(() => { shown.cloud = ''; });
}

const events = new EventSource('events');
events.onmessage = (event) => show(JSON.parse(event.data));
events.onerror = () => showLink({ text: 'the ground station does not answer', level: 2, rate: 0 });

for (const button of document.querySelectorAll('[data-command]')) {
  button.addEventListener('click', async () => {
    if (button.dataset.sure && !confirm(button.dataset.sure)) return;
    const said = byId('answer');
    button.disabled = true;
    said.className = '';
    said.textContent = `${button.textContent}: waiting for the drone`;
    try {
      const answer = await fetch(`command/${button.dataset.command}`, { method: 'POST', headers: { 'X-Ftp-Dent': 'command' } });
      const { success, message } = await answer.json();
      said.className = success ? '' : 'failed';
      said.textContent = `${button.textContent}: ${success ? 'done' : 'failed'}. ${message}`;
    } catch {
      said.className = 'failed';
      said.textContent = `${button.textContent}: failed. The ground station does not answer.`;
    }
    button.disabled = false;
  });
}

byId('turn').addEventListener('click', (event) => {
  const above = mapView.axes[1] === 2;
  mapView.axes = above ? [0, 1] : [0, 2];
  event.target.textContent = above ? 'from above' : 'from the south';
  mapView.draw();
});
