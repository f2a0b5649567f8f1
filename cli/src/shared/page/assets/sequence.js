// The page of a sequence: surfaces with the same triangles, one after another, and curves of what was measured of them.

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, MeshBasicMaterial, ShaderMaterial, SphereGeometry } from 'three';
import { SCALE_CODE, Scale, legend } from 'page/colours';
import { Curve } from 'page/curve';
import { button, choice, dataTable, element, group, list, remark, significant, slider, tick } from 'page/elements';
import { Morphed } from 'page/pick';
import { Stage } from 'page/stage';

/** Frames each second where times are the numbers of frames. */
const RATE = 8;
const [SLOWEST, FASTEST] = [1, 60];
/** How far logarithmic scales reach down. */
const DECADES = 4;

const SHADER = {
  vertexShader: `
attribute float value;
varying vec3 seen;
varying float shown;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  seen = place.xyz;
  shown = value;
  gl_Position = projectionMatrix * place;
}`,
  fragmentShader: `
varying vec3 seen;
varying float shown;
${SCALE_CODE}
void main() {
  float facing = abs(dot(normalize(cross(dFdx(seen), dFdy(seen))), normalize(seen)));
  float light = gl_FrontFacing ? 0.4 + 0.6 * facing : 0.3 + 0.25 * facing;
  gl_FragColor = vec4(scaleColour(shown) * light, 1.0);
}`,
};

const SHADOW = {
  vertexShader: 'void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
  fragmentShader: 'void main() { gl_FragColor = vec4(vec3(0.5), 0.16); }',
};

export function showSequence(data, arrays) {
  return new SequencePage(data, arrays).element;
}

class SequencePage {
  constructor(data, arrays) {
    Object.assign(this, { data, arrays });
    this.fields = new Map(data.fields.map((field) => [field.key, field]));
    this.count = data.shown.length;
    this.state = { frame: 0, field: data.fields[0].key, rate: rateOf(data), playing: false };
    this.stage = new Stage(['Frame'], data.up);
    this.#build();
    this.stage.show(...this.#extremes());
    this.readout = element('div', { class: 'readout wide', 'aria-label': 'the frame, and the point under the pointer' });
    this.curve = new Curve(data, (frame) => this.go(frame));
    const controls = this.#controls();
    this.element = element('div', {}, element('div', { class: 'workbench played' },
      element('div', {}, this.stage.element, this.#playback(), this.curve.canvas, this.readout), controls), this.#table());
    this.element.addEventListener('keydown', (event) => {
      if (event.key !== ' ' || event.target.tagName !== 'CANVAS') return;
      event.preventDefault();
      this.play(!this.state.playing);
    });
    this.stage.beforeDraw = () => this.#update();
    this.stage.onPointer((_, ray) => {
      this.ray = ray;
      this.#say();
    });
    this.#curve(0);
    this.#show();
    // For tests and the console: what is shown.
    window.solidmapPage = this;
  }

  #build() {
    const { triangles } = this.arrays;
    // Every triangle has corners of its own, so that it may have one value.
    this.position = new BufferAttribute(new Float32Array(3 * triangles.length), 3);
    this.value = new BufferAttribute(new Float32Array(triangles.length), 1);
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute('position', this.position);
    this.geometry.setAttribute('value', this.value);
    this.colourScale = new Scale(this.data.palettes);
    this.uniforms = this.colourScale.uniforms;
    this.surface = new Mesh(this.geometry, new ShaderMaterial({ ...SHADER, uniforms: this.uniforms, side: DoubleSide }));
    const reference = new BufferGeometry();
    reference.setAttribute('position', new BufferAttribute(this.arrays.reference, 3));
    reference.setIndex(new BufferAttribute(triangles, 1));
    this.shadow = new Mesh(reference, new ShaderMaterial({ ...SHADOW, transparent: true, depthWrite: false, side: DoubleSide }));
    this.shadow.visible = false;
    this.marker = new Mesh(new SphereGeometry(0.012), new MeshBasicMaterial({ color: 0xff2020, depthTest: false }));
    this.marker.renderOrder = 1;
    this.marker.visible = false;
    for (const part of [this.surface, this.shadow, this.marker]) {
      part.frustumCulled = false;
      this.stage.views[0].scene.add(part);
    }
  }

  /** A few of the frames, so that the whole motion is in view. */
  #extremes() {
    const step = Math.ceil(this.count / 12);
    const frames = [this.arrays.reference];
    for (let n = 0; n < this.count; n += step) frames.push(this.#places(n));
    return frames;
  }

  /** The field that is shown; with a logarithmic scale over the upper decades of its amounts. */
  #field() {
    const field = this.fields.get(this.state.field);
    if (!this.state.logarithmic || !(field.high > 0)) return field;
    return { ...field, logarithmic: true, low: field.high / 10 ** DECADES, clamps: true };
  }

  #places(n) {
    return this.arrays[`frame-${n}`];
  }

  /** What a frame is, in words. */
  #name(n) {
    const { frame, file } = this.data.rows[this.data.shown[n]];
    return `frame ${frame}: ${file}`;
  }

  #playback() {
    this.button = button('Play', () => this.play(!this.state.playing));
    this.slider = slider('frame', {
      max: Math.max(this.count - 1, 0), step: 1, value: 0, shown: (n) => this.#name(n),
    }, (n) => this.go(n));
    return element('div', { class: 'playback' }, this.button, this.slider.element);
  }

  #controls() {
    const { data, state } = this;
    const fields = choice('by', data.fields.map(({ key, label }) => [key, label]), state.field, (field) => {
      state.field = field;
      recoloured();
    });
    const recoloured = () => {
      this.legend.show(this.#field());
      this.#show();
    };
    const logarithmic = tick('logarithmic scale', false, (is) => {
      state.logarithmic = is;
      recoloured();
    });
    this.legend = legend(data.palettes);
    this.legend.show(this.#field());
    const curves = choice('of', data.curves.map(({ label }, n) => [n, label]), 0, (n) => this.#curve(Number(n)));
    this.meaning = remark('');
    const rate = slider('speed', {
      min: SLOWEST, max: FASTEST, step: 1, value: state.rate, shown: (value) => `${value} frames a second`,
    }, (value) => { state.rate = value; });
    const first = data.from_first ? 'first frame as a shadow' : 'reference as a shadow';
    return element('div', { class: 'controls' },
      group('Colour', fields.element, logarithmic.element, this.legend.element),
      group('Curve', curves.element, this.meaning, remark('Click on it to go to a frame.')),
      group('Play', rate.element, remark('Space plays and stops, where the view or the curve has the focus.')),
      group('Show', tick(first, false, (visible) => {
        this.shadow.visible = visible;
        this.stage.draw();
      }).element),
      element('div', { class: 'row' },
        button('Save picture', () => this.stage.save('solidmap.png')),
        button('First view', () => this.stage.home())));
  }

  #curve(n) {
    const { values, label, meaning } = this.data.curves[n];
    this.meaning.textContent = `${meaning}.`;
    this.curve.show(values, label);
  }

  /** All rows, folded up: there may be many. */
  #table() {
    const { rows, curves, across } = this.data;
    const isTimed = across === 'time';
    const column = (align) => (head) => ({ head, unit: '', align });
    const words = column('left');
    const numbers = column('right');
    const lines = rows.map(({ frame, time, file, skipped }, row) => {
      const values = curves.map((curve) => (curve.values[row] === null ? '–' : significant(curve.values[row])));
      return [String(frame), ...(isTimed ? [significant(time, 6)] : []), file, ...(skipped ? [skipped] : values)];
    });
    const columns = [words('frame'), ...(isTimed ? [numbers('time')] : []), words('file'), ...curves.map(({ label }) => numbers(label))];
    return element('details', {}, element('summary', {}, 'All frames'), dataTable({ columns, rows: lines, named: 1 }));
  }

  /** Goes to a frame. */
  go(frame) {
    if (frame === this.state.frame) return;
    this.state.frame = frame;
    this.#show();
  }

  /** Plays, or stops. */
  play(playing) {
    this.state.playing = playing && this.count > 1;
    this.button.textContent = this.state.playing ? 'Stop' : 'Play';
    cancelAnimationFrame(this.waiting);
    if (!this.state.playing) return;
    let last;
    let due = 0;
    const step = (now) => {
      due += ((now - (last ?? now)) / 1000) * this.state.rate;
      last = now;
      const steps = Math.floor(due);
      due -= steps;
      // Where drawing takes longer, frames are left out: the motion keeps its speed.
      if (steps) this.go((this.state.frame + steps) % this.count);
      this.waiting = requestAnimationFrame(step);
    };
    this.waiting = requestAnimationFrame(step);
  }

  #show() {
    const { frame } = this.state;
    const name = this.#name(frame);
    this.stale = true;
    this.slider.input.value = frame;
    this.slider.update();
    this.curve.mark(frame, name);
    this.stage.views[0].text.textContent = name;
    this.#say();
  }

  /** The values of a field in a frame. */
  #values({ key, over }, frame) {
    if (over !== 'displacement') return this.arrays[`frame-${frame}-${key}`];
    const [places, from] = [this.#places(frame), this.arrays.reference];
    const { radius } = this.data.framing;
    const found = new Float32Array(places.length / 3);
    for (let v = 0; v < found.length; v++) {
      const k = 3 * v;
      found[v] = radius * Math.hypot(places[k] - from[k], places[k + 1] - from[k + 1], places[k + 2] - from[k + 2]);
    }
    return found;
  }

  #update() {
    if (!this.stale) return;
    this.stale = false;
    const { triangles } = this.arrays;
    const { frame } = this.state;
    const field = this.#field();
    const places = this.#places(frame);
    const values = this.#values(field, frame);
    const ofTriangles = field.over === 'triangles';
    const [position, value] = [this.position.array, this.value.array];
    for (let n = 0; n < triangles.length; n++) {
      const from = 3 * triangles[n];
      position[3 * n] = places[from];
      position[3 * n + 1] = places[from + 1];
      position[3 * n + 2] = places[from + 2];
      value[n] = values[ofTriangles ? Math.floor(n / 3) : triangles[n]];
    }
    this.position.needsUpdate = true;
    this.value.needsUpdate = true;
    this.colourScale.use(field);
  }

  /** What the frame is, and the point under the pointer; while it plays, the frame alone. */
  #say() {
    const { data, arrays, state } = this;
    const row = data.shown[state.frame];
    const { frame, time, file } = data.rows[row];
    const places = this.#places(state.frame);
    const picked = new Morphed(places, places, arrays.triangles);
    const hit = this.ray && !state.playing && picked.hit(this.ray, 0, () => true);
    const entries = [['frame', `${frame} (${file})`]];
    if (data.across === 'time') entries.push(['time', significant(time, 6)]);
    this.marker.visible = Boolean(hit);
    if (hit) {
      const { centre, radius } = data.framing;
      const shown = (point) => `(${point.map((x, k) => significant(centre[k] + radius * x, 6)).join(', ')})`;
      entries.push(['triangle (from 0)', String(hit.triangle)], ['point', shown(hit.point)]);
      entries.push([data.from_first ? 'in the first frame' : 'in the reference', shown(picked.weighted(arrays.reference, hit))]);
      for (const field of data.fields) entries.push([field.label, significant(this.#at(field, hit), 5)]);
      this.marker.position.set(...hit.point);
    } else {
      for (const { label, values } of data.curves) {
        if (values[row] !== null) entries.push([label, significant(values[row], 5)]);
      }
    }
    this.readout.replaceChildren(list(entries));
    this.stage.draw();
  }

  #at(field, { triangle, weights }) {
    const values = this.#values(field, this.state.frame);
    if (field.over === 'triangles') return values[triangle];
    return weights.reduce((sum, weight, k) => sum + weight * values[this.arrays.triangles[3 * triangle + k]], 0);
  }
}

/** Frames each second: those of the times where these are no numbers of frames, so that the page plays in real time. */
function rateOf({ rows, shown, across }) {
  if (across === 'frame' || shown.length < 2) return RATE;
  const [first, last] = [rows[shown[0]].time, rows[shown.at(-1)].time];
  return Math.min(FASTEST, Math.max(SLOWEST, Math.round((shown.length - 1) / (last - first))));
}
