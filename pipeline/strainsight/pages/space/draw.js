// The shaders, the buffers and one frame of the view in space.
const VERTEX = `#version 300 es
in vec3 position, normal, colour, shift;
uniform vec3 low, span, centre, own;
uniform float amount, plain, dotSize, depth;
uniform vec2 zoom, pan;
uniform mat3 turn;
out vec3 shown;
void main() {
  vec3 eye = turn * (low + span * position + amount * shift - centre);
  vec3 n = turn * normal;
  // Lines and dots are on the surface: they are drawn slightly in front of it.
  gl_Position = vec4(eye.xy * zoom + pan, -eye.z * depth - (plain > 0.0 ? 0.0015 : 0.0), 1.0);
  gl_PointSize = dotSize;
  float light = 0.44 + 0.46 * abs(n.z) + 0.2 * max(dot(n, vec3(-0.45, 0.75, 0.48)), 0.0);
  shown = plain > 0.0 ? mix(colour, own, plain - 1.0) : colour * light;
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec3 shown;
uniform float round;
out vec4 pixel;
void main() {
  if (round > 0.0 && length(gl_PointCoord - 0.5) > 0.5) discard;
  pixel = vec4(shown, 1.0);
}`;

// Function that draws one frame with this WebGL 2 context, from consecutive arrays in `bytes`.
function drawer(gl, given, bytes) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  let offset = 0;
  const take = (length) => bytes.slice(offset, offset += length);
  const count = given.vertices, at = (name) => gl.getAttribLocation(program, name);
  const uniform = (name) => gl.getUniformLocation(program, name);
  const stored = (data, target = gl.ARRAY_BUFFER) => {
    const buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, data, gl.STATIC_DRAW);
    return buffer;
  };
  function point(name, buffer, type) {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(at(name));
    gl.vertexAttribPointer(at(name), 3, type, true, 0, 0);
  }
  point("position", stored(take(6 * count)), gl.UNSIGNED_SHORT);
  point("normal", stored(take(3 * count)), gl.BYTE);
  const own = take(3 * count), plain = stored(own);
  const parts = given.parts.map((part) => ({ ...part, buffer: stored(take(4 * part.count), gl.ELEMENT_ARRAY_BUFFER) }));
  // Colour of a position on the scale, 0 to 254, between its stops; 255: none.
  function painted(stops, places) {
    const colour = own.slice();
    places.forEach((place, i) => {
      if (place === 255) return;
      const at = place / 254 * (stops.length - 1), low = Math.min(Math.floor(at), stops.length - 2);
      for (let k = 0; k < 3; k++) colour[3 * i + k] = Math.round(stops[low][k] + (at - low) * (stops[low + 1][k] - stops[low][k]));
    });
    return stored(colour);
  }
  const states = given.states.map(({ largest, stops }) => {
    const shift = largest > 0 ? new Int8Array(take(3 * count).buffer) : null;
    const colour = stops.length ? painted(stops, take(given.surface)) : plain;
    return { shift, buffer: shift && stored(shift), colour };
  });
  gl.uniform3fv(uniform("low"), given.low);
  gl.uniform3fv(uniform("span"), given.span);
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);
  gl.polygonOffset(1, 1);

  function frame({ turn, centre, state, group, gauges, ratio, amount, depth, zoom, pan }) {
    gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix3fv(uniform("turn"), true, turn.flat());
    gl.uniform3fv(uniform("centre"), centre);
    gl.uniform2fv(uniform("zoom"), zoom);
    gl.uniform2fv(uniform("pan"), pan);
    gl.uniform1f(uniform("depth"), depth);
    gl.uniform1f(uniform("amount"), amount);
    point("colour", states[state]?.colour ?? plain, gl.UNSIGNED_BYTE);
    if (states[state]?.shift) point("shift", states[state].buffer, gl.BYTE);
    else gl.disableVertexAttribArray(at("shift"));
    const contour = Boolean(given.states[state]?.stops.length);
    const modes = { triangles: gl.TRIANGLES, lines: gl.LINES, points: gl.POINTS };
    for (const { primitive, buffer, count: size, colour: own, size: dot, group: only, when } of parts) {
      if (only >= 0 && only !== group || when && ![gauges, contour ? "" : "plain"].includes(when)) continue;
      (primitive === "triangles" ? gl.enable : gl.disable).call(gl, gl.POLYGON_OFFSET_FILL);
      gl.uniform1f(uniform("plain"), primitive === "triangles" ? 0 : own ? 2 : 1);
      gl.uniform3fv(uniform("own"), own ? [1, 3, 5].map((i) => parseInt(own.slice(i, i + 2), 16) / 255) : [0, 0, 0]);
      gl.uniform1f(uniform("dotSize"), dot * ratio);
      gl.uniform1f(uniform("round"), primitive === "points" ? 1 : 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.drawElements(modes[primitive], size, gl.UNSIGNED_INT, 0);
    }
  }
  const shift = (state, i) => [0, 1, 2].map((k) => (states[state]?.shift ? states[state].shift[3 * i + k] / 127 : 0));
  return { frame, shift };
}
