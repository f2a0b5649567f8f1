// How a map is drawn. Every vertex knows where it is in the domain and in the target, and `amount` is how far it has gone.

const VERTEX = `
attribute vec3 image;
uniform float amount;
varying vec3 domain;
varying vec3 seen;
void main() {
  vec4 place = modelViewMatrix * vec4(mix(position, image, amount), 1.0);
  domain = position;
  seen = place.xyz;
  gl_Position = projectionMatrix * place;
}`;

/** How bright a face is that a lamp at the eye lights. */
const LIGHT = `
varying vec3 seen;
float facing() {
  return abs(dot(normalize(cross(dFdx(seen), dFdy(seen))), normalize(seen)));
}`;

/** The pattern on a domain: cubes of its box, told apart by shade, and coloured by place where asked for. */
export const CHECKER_CODE = `
uniform vec3 low;
uniform vec3 extent;
vec3 checkerColour(vec3 domain, bool coloured) {
  // The box is offset in the pattern, so that its faces lie inside cubes, not between them.
  vec3 cube = floor((domain - low) / max(max(extent.x, extent.y), extent.z) * 14.0 + 0.382);
  bool odd = mod(cube.x + cube.y + cube.z, 2.0) >= 1.0;
  vec3 share = clamp((domain - low) / max(extent, vec3(1e-9)), 0.0, 1.0);
  if (coloured) return (0.24 + 0.76 * share) * (odd ? 0.64 : 1.0);
  return odd ? vec3(0.60, 0.63, 0.67) : vec3(0.86, 0.87, 0.89);
}`;

export const SURFACE_SHADER = {
  vertexShader: VERTEX,
  fragmentShader: `
varying vec3 domain;
uniform vec3 clipAxis;
uniform float clipAt;
uniform int pattern;
${CHECKER_CODE}
${LIGHT}
void main() {
  if (dot(domain, clipAxis) > clipAt) discard;
  vec3 colour = pattern == 0 ? vec3(0.78, 0.80, 0.82) : checkerColour(domain, pattern == 2);
  float light = gl_FrontFacing ? 0.35 + 0.65 * facing() : 0.30 + 0.25 * facing();
  gl_FragColor = vec4(colour * light, 1.0);
}`,
};

export const CUT_SHADER = {
  vertexShader: `
attribute vec3 image;
attribute float value;
attribute float volume;
uniform float amount;
varying vec3 domain;
varying vec3 seen;
varying vec2 place;
varying float shown;
varying float grown;
void main() {
  vec4 moved = modelViewMatrix * vec4(mix(position, image, amount), 1.0);
  domain = position;
  seen = moved.xyz;
  place = uv;
  shown = value;
  grown = volume;
  gl_Position = projectionMatrix * moved;
}`,
  fragmentShader: `
varying vec3 domain;
varying vec2 place;
varying float shown;
varying float grown;
uniform sampler2D mask;
uniform sampler2D labels;
uniform vec2 squares;
uniform vec3 wrong;
uniform vec3 extent;
uniform vec3 low;
uniform float lines;
${LIGHT}
void main() {
  if (texture2D(mask, place).r < 0.5) discard;
  float label = texture2D(labels, (place * (squares - 1.0) + 0.5) / squares).r;
  vec3 colour = grown <= 0.0 ? wrong : scaleColour(labelColours > 0.0 ? label : shown);
  vec3 cell = (domain - low) / max(max(extent.x, extent.y), extent.z) * 32.0;
  vec3 near = abs(fract(cell - 0.5) - 0.5) / max(fwidth(cell), vec3(1e-6));
  // Along the axis of the cut nothing changes, and there are no lines.
  vec3 moves = step(vec3(1e-5), fwidth(cell));
  vec3 off = mix(vec3(1e3), near, moves);
  float line = lines * (1.0 - clamp(min(min(off.x, off.y), off.z) - 0.2, 0.0, 1.0));
  gl_FragColor = vec4(mix(colour, vec3(0.0), 0.55 * line) * (0.78 + 0.22 * facing()), 1.0);
}`,
};

export const LINE_SHADER = {
  vertexShader: VERTEX,
  fragmentShader: `
uniform vec3 line;
void main() { gl_FragColor = vec4(line, 1.0); }`,
};
