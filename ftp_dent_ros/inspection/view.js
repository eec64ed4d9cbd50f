'use strict';
// The measured skin as a mesh that can be turned: WebGL 2 and nothing else.
(function () {
  const scene = JSON.parse(document.getElementById('scene').textContent);
  const box = document.getElementById('view');
  const canvas = box.querySelector('canvas');
  const slider = document.getElementById('depth');
  const times = document.getElementById('times');
  box.hidden = false;
  const gl = scene.meshes.length &&
    canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    box.className = 'dead';
    box.textContent = scene.meshes.length
      ? 'This browser shows no 3-D graphics (WebGL 2): the maps below hold the same.'
      : 'Nothing was measured.';
    document.querySelector('.controls').hidden = true;
    return;
  }

  const decode = (text) =>
    new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const add = (a, b, s) => a.map((value, i) => value + s * b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((value) => value / (Math.hypot(...a) || 1));

  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, '#version 300 es\nprecision highp float;\n' + text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return made;
  };
  const skin = program(
    `in vec4 point; uniform vec3 inward; uniform float times; uniform mat4 camera;
     out vec3 at; out float depth;
     void main() {
       depth = point.w;
       at = point.xyz + (times - 1.0) * depth * inward;
       gl_Position = camera * vec4(at, 1.0);
     }`,
    `in vec3 at; in float depth; out vec4 colour;
     uniform sampler2D colours; uniform float limit; uniform vec3 light;
     void main() {
       vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
       float shade = 0.62 + 0.38 * abs(dot(normal, light));
       colour = vec4(shade * texture(colours, vec2(0.5 + 0.498 * depth / limit, 0.5)).rgb, 1.0);
     }`);
  const edge = program(
    'in vec3 point; uniform mat4 camera; void main() { gl_Position = camera * vec4(point, 1.0); }',
    'out vec4 colour; void main() { colour = vec4(0.06, 0.08, 0.09, 1.0); }');

  const buffer = (target, data) => {
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, data, gl.STATIC_DRAW);
    return made;
  };
  const attribute = (of, name, size, data) => {
    const where = gl.getAttribLocation(of, name);
    buffer(gl.ARRAY_BUFFER, data);
    gl.enableVertexAttribArray(where);
    gl.vertexAttribPointer(where, size, gl.FLOAT, false, 0, 0);
  };

  const meshes = scene.meshes.map((mesh) => {
    const vertices = decode(mesh.vertices);
    const indices = [];
    const there = (...corners) => corners.every((i) => !Number.isNaN(vertices[4 * i]));
    for (let row = 0; row + 1 < mesh.rows; row++) {
      for (let column = 0; column + 1 < mesh.columns; column++) {
        const a = row * mesh.columns + column, b = a + 1, c = a + mesh.columns, d = c + 1;
        if (there(a, b, c)) indices.push(a, b, c);
        if (there(b, c, d)) indices.push(b, d, c);
      }
    }
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    attribute(skin, 'point', 4, vertices);
    buffer(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(indices));
    return { vao, count: indices.length, inward: mesh.inward };
  });

  const outward = unit(scene.inward.map((value) => -value));
  const lines = scene.dents.map((dent) => {
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const points = new Float32Array(dent.outline);
    // A little before the skin, so that it does not hide them.
    for (let i = 0; i < points.length; i++) points[i] += 2e-3 * dent.normal[i % 3];
    attribute(edge, 'point', 3, points);
    const label = document.createElement('span');
    label.className = 'label';
    label.textContent = dent.number;
    box.appendChild(label);
    return { vao, count: points.length / 3, label, position: dent.position };
  });

  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE,
    new Uint8Array(scene.colours));
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
    gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
  }
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
    gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  }
  gl.enable(gl.DEPTH_TEST);
  gl.clearColor(0.961, 0.965, 0.969, 1);

  // Seen as the camera saw it, turned a little; the axes of the screen in the scene.
  const down = unit(add(scene.down, outward, -dot(scene.down, outward)));
  const right = cross(down, outward.map((value) => -value));
  // From how many radii it is seen, and how large, so that all of it is in view.
  const DISTANCE = 3.4;
  const magnification = () =>
    DISTANCE * Math.max(0.85, Math.min(1.6, 0.62 * canvas.clientWidth / canvas.clientHeight));
  let turn, tilt, zoom, shift, waiting = false;
  const reset = () => { turn = -0.35; tilt = 0.35; zoom = 1; shift = [0, 0]; };

  const draw = () => {
    waiting = false;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const up = down.map((value) => -value);
    const around = add(outward.map((v) => v * Math.cos(turn)), right, Math.sin(turn));
    const x = unit(cross(up, around));
    const back = unit(add(around.map((v) => v * Math.cos(tilt)), up, Math.sin(tilt)));
    const y = cross(back, x);
    const distance = DISTANCE * scene.radius / zoom;
    const eye = [shift[0], shift[1], distance];
    const focal = magnification();
    const near = distance * 0.05, far = distance + 3 * scene.radius;
    const depth = [(far + near) / (near - far), 2 * far * near / (near - far)];
    const fx = focal * height / width;
    // Column by column: the scene's axes x, y, back, then the perspective.
    const camera = [];
    for (let i = 0; i < 3; i++) {
      camera.push(fx * x[i], focal * y[i], depth[0] * back[i], -back[i]);
    }
    camera.push(fx * eye[0], focal * eye[1], depth[0] * -eye[2] + depth[1], eye[2]);
    const amount = Number(slider.value);
    times.textContent = `× ${amount}`;

    gl.useProgram(skin);
    const place = (name) => gl.getUniformLocation(skin, name);
    gl.uniformMatrix4fv(place('camera'), false, camera);
    gl.uniform1f(place('times'), amount);
    gl.uniform1f(place('limit'), scene.limit);
    gl.uniform3fv(place('light'), unit(add(add(back, y, 0.5), x, -0.4)));
    for (const mesh of meshes) {
      gl.uniform3fv(place('inward'), mesh.inward);
      gl.bindVertexArray(mesh.vao);
      gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    }
    gl.useProgram(edge);
    gl.uniformMatrix4fv(gl.getUniformLocation(edge, 'camera'), false, camera);
    for (const line of lines) {
      gl.bindVertexArray(line.vao);
      gl.drawArrays(gl.LINE_LOOP, 0, line.count);
      const p = [...line.position, 1];
      const clip = [0, 1, 2, 3].map((i) => p.reduce((sum, v, k) => sum + v * camera[4 * k + i], 0));
      line.label.style.left = `${50 + 50 * clip[0] / clip[3]}%`;
      line.label.style.top = `${50 - 50 * clip[1] / clip[3]}%`;
      const inside = clip[3] > 0 && Math.abs(clip[0]) < clip[3] && Math.abs(clip[1]) < clip[3];
      line.label.hidden = !inside;
    }
  };
  const redraw = () => {
    if (!waiting) { waiting = true; requestAnimationFrame(draw); }
  };

  const move = (dx, dy) => {
    const size = 2 * DISTANCE * scene.radius / zoom / magnification() / canvas.clientHeight;
    shift = [shift[0] + dx * size, shift[1] - dy * size];
  };
  const rotate = (dx, dy) => {
    turn -= dx * 0.008;
    tilt = Math.max(-1.5, Math.min(1.5, tilt + dy * 0.008));
  };
  const magnify = (factor) => { zoom = Math.max(0.4, Math.min(60, zoom * factor)); };
  const fingers = new Map();
  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });
  for (const name of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener('pointermove', (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
      magnify(apart(now) / Math.max(apart(before), 1));
      move(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons === 2) {
      move(dx, dy);
    } else {
      rotate(dx, dy);
    }
    fingers.set(event.pointerId, now);
    redraw();
  });
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    magnify(Math.exp(-0.0012 * event.deltaY));
    redraw();
  }, { passive: false });
  const keys = {
    ArrowLeft: () => rotate(-12, 0), ArrowRight: () => rotate(12, 0),
    ArrowUp: () => rotate(0, -12), ArrowDown: () => rotate(0, 12),
    '+': () => magnify(1.15), '-': () => magnify(1 / 1.15), 0: () => reset(),
  };
  canvas.addEventListener('keydown', (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
    redraw();
  });
  canvas.addEventListener('dblclick', () => { reset(); redraw(); });
  document.getElementById('reset').addEventListener('click', () => { reset(); redraw(); });
  slider.addEventListener('input', redraw);
  window.addEventListener('resize', redraw);
  window.addEventListener('beforeprint', draw);
  window.addEventListener('afterprint', redraw);
  reset();
  draw();
})();
