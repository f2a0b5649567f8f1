// The page of a map: domain and target side by side, a cut through both, and what the map does at the point under the pointer.

import {
  BoxGeometry, BufferAttribute, BufferGeometry, DoubleSide, InstancedMesh, LineSegments, Matrix4, Mesh, MeshBasicMaterial, ShaderMaterial, SphereGeometry,
  Vector2, Vector3,
} from 'three';
import { replace, replaceCut } from 'page/buffers';
import { SCALE_CODE, Scale, legend } from 'page/colours';
import { Cut, Lattice } from 'page/cut';
import { CutControls, boxOf } from 'page/cut-controls';
import { button, choice, element, group, list, remark, significant, slider, tick, triple } from 'page/elements';
import { deformationDensity, determinant, evaluate, harmonicDensity, stretches } from 'page/harmonic';
import { Morphed, isInside } from 'page/pick';
import { CUT_SHADER, LINE_SHADER, SURFACE_SHADER } from 'page/map-shaders';
import { Stage } from 'page/stage';

const AXES = ['x', 'y', 'z'];
const CHECKERS = [['checker', 'checker'], ['coloured', 'checker, coloured by place'], ['plain', 'plain'], ['hidden', 'hidden']];

export function showMap(data, arrays) {
  return new MapPage(data, arrays).element;
}

class MapPage {
  constructor(data, arrays) {
    Object.assign(this, { data, arrays });
    this.fields = new Map(data.fields.map((field) => [field.key, field]));
    this.lattice = new Lattice(data.lattice);
    this.surface = { vertices: arrays.domain, images: arrays.image, indices: arrays.triangles };
    this.cut = new Cut(this.lattice, [0, 1, 2].map((k) => arrays[`lattice-${k}`]), this.surface, data.domain);
    this.picked = new Morphed(arrays.domain, arrays.image, arrays.triangles);
    this.box = boxOf(arrays.domain, data.domain);
    this.stage = new Stage(['Domain', 'Target'], data.up);
    this.stage.show(arrays.domain, arrays.image);
    this.state = { ...CutControls.start(this.stage, data.up), amount: 1, field: data.fields[0].key, lines: false, boundary: 'checker' };
    this.#build();
    this.readout = element('div', { class: 'readout wide', 'aria-label': 'values at a point' });
    this.stage.onPointer((view, ray) => this.#hover(view, ray));
    this.stage.beforeDraw = () => this.#update();
    this.stale = { cut: true, values: true };
    this.#say(undefined);
    this.element = element('div', { class: 'workbench' },
      element('div', {}, this.stage.element, this.readout), this.#controls());
    // For tests and the console: where things are, and what they are.
    window.solidmapPage = this;
  }

  #build() {
    const { arrays, data } = this;
    this.surfaceGeometry = new BufferGeometry();
    this.surfaceGeometry.setAttribute('position', new BufferAttribute(arrays.domain, 3));
    this.surfaceGeometry.setAttribute('image', new BufferAttribute(arrays.image, 3));
    this.surfaceGeometry.setIndex(new BufferAttribute(arrays.triangles, 1));
    this.cutGeometry = new BufferGeometry();
    this.outlineGeometry = new BufferGeometry();
    this.colourScale = new Scale(data.palettes);
    const [low, high] = this.box.map((corner) => corner.map((x, k) => (x - data.domain.centre[k]) / data.domain.radius));
    const shared = {
      clipAxis: { value: new Vector3() },
      clipAt: { value: 0 },
      pattern: { value: 0 },
      low: { value: new Vector3(...low) },
      extent: { value: new Vector3(...high.map((x, k) => x - low[k])) },
      mask: { value: null },
      ...this.colourScale.uniforms,
      labels: { value: null },
      squares: { value: new Vector2() },
      wrong: { value: new Vector3(...data.palettes.wrong).divideScalar(255) },
      lines: { value: 0 },
      line: { value: new Vector3() },
    };
    this.shared = shared;
    this.views = this.stage.views.map(({ scene }, number) => {
      const uniforms = { ...shared, amount: { value: number } };
      const made = (shader, more = {}) => new ShaderMaterial({ ...shader, uniforms, side: DoubleSide, ...more });
      const surface = new Mesh(this.surfaceGeometry, made(SURFACE_SHADER));
      const cut = new Mesh(this.cutGeometry, made({ ...CUT_SHADER, fragmentShader: SCALE_CODE + CUT_SHADER.fragmentShader }));
      const outline = new LineSegments(this.outlineGeometry, made(LINE_SHADER));
      const marker = new Mesh(new SphereGeometry(0.016), new MeshBasicMaterial({ color: 0xff2020, depthTest: false }));
      marker.renderOrder = 1;
      marker.visible = false;
      // Places come from shaders, so that three.js does not know what is in view.
      for (const part of [surface, cut, outline, marker]) {
        part.frustumCulled = false;
        scene.add(part);
      }
      return { surface, cut, outline, marker, uniforms };
    });
    const { wrong } = data.palettes;
    this.boxes = arrays.folded && {
      folded: boxes(arrays.folded, wrong.map((part) => part / 255), 0.45),
      undecided: boxes(arrays.undecided, [0.5, 0.5, 0.5], 0.12),
    };
    if (this.boxes) {
      // They lie around the folded ones, and would hide them.
      this.boxes.undecided.visible = false;
      this.stage.views[0].scene.add(this.boxes.folded, this.boxes.undecided);
    }
  }

  #controls() {
    const { state } = this;
    const changed = (change, stale = {}) => {
      Object.assign(state, change);
      Object.assign(this.stale, stale);
      this.stage.draw();
    };
    const lines = tick('lattice lines on the cut', false, (shown) => changed({ lines: shown }));
    this.plane = new CutControls(this, this.data.domain.radius, (moved) => changed({}, moved ? { cut: true } : {}), lines.element);
    const morph = slider('move', {
      value: 1,
      step: 0.01,
      shown: (value) => (value === 1 ? 'at the image' : value === 0 ? 'at the domain' : `${Math.round(100 * value)} % of the way`),
    }, (amount) => changed({ amount }));
    const fields = choice('by', this.data.fields.map(({ key, label }) => [key, label]), state.field, (field) => {
      changed({ field }, { values: true });
      this.legend.show(this.fields.get(field));
    });
    this.legend = legend(this.data.palettes, 'folded: det J has not the sign of the target’s orientation');
    this.legend.show(this.fields.get(state.field));
    return element('div', { class: 'controls' },
      group('Colour', fields.element, this.legend.element),
      this.plane.element,
      group('Boundary', choice('pattern', CHECKERS, state.boundary, (boundary) => changed({ boundary })).element),
      group('Target', morph.element,
        remark('Points move to their images along straight lines, with both solids scaled to one size.')),
      ...(this.boxes ? [group('Certificate', ...Object.entries(this.boxes).map(([name, mesh]) => (
        tick(`${name} boxes`, mesh.visible, (visible) => {
          mesh.visible = visible;
          this.stage.draw();
        }).element)), remark('Of the domain: magenta where the map is proved to be folded, grey where nothing is proved.'))] : []),
      group('A point of the domain', triple('point', AXES, (point) => this.#probe(point))),
      element('div', { class: 'row' },
        button('Save picture', () => this.stage.save('solidmap.png')),
        button('First view', () => this.stage.home())));
  }

  /** Brings what is drawn up to date. */
  #update() {
    const { state, shared, cut, stale } = this;
    if (stale.cut) this.#cutAgain();
    if (stale.cut || stale.values) this.#colourAgain();
    this.stale = { cut: false, values: false };
    const { centre, radius } = this.data.domain;
    const at = (this.plane.coordinate() - centre[state.axis]) / radius;
    shared.clipAxis.value.set(0, 0, 0).setComponent(state.axis, state.side);
    shared.clipAt.value = state.cutting ? state.side * at : 1e9;
    shared.pattern.value = { plain: 0, checker: 1, coloured: 2, hidden: 0 }[state.boundary];
    shared.lines.value = state.lines ? 1 : 0;
    const dark = window.matchMedia('(prefers-color-scheme: dark)').matches;
    shared.line.value.setScalar(dark && !state.cutting ? 0.95 : 0.08);
    this.views[1].uniforms.amount.value = state.amount;
    const caption = state.amount === 1 ? 'Target' : `${Math.round(100 * state.amount)} % of the way to the target`;
    this.stage.views[1].text.textContent = caption;
    for (const { surface, cut: plane, outline } of this.views) {
      surface.visible = state.boundary !== 'hidden';
      plane.visible = state.cutting && cut.indices.length > 0;
      outline.visible = state.cutting;
    }
  }

  #cutAgain() {
    const { cut } = this;
    cut.at(this.state.axis, this.plane.coordinate());
    this.shared.mask.value?.dispose();
    this.shared.mask.value = replaceCut(cut, this.cutGeometry, this.outlineGeometry);
    this.pickedCut = new Morphed(cut.domain, cut.image, cut.indices);
  }

  #colourAgain() {
    const { cut, arrays, shared } = this;
    const field = this.fields.get(this.state.field);
    replace(this.cutGeometry, {
      value: [cut.interpolated(arrays[`field-${field.key}`]), 1],
      volume: [cut.interpolated(arrays['field-volume']), 1],
    });
    this.colourScale.use(field);
    shared.labels.value?.dispose();
    shared.labels.value = field.palette === 'labels' ? cut.nearest(arrays[`field-${field.key}`]) : null;
    shared.squares.value.set(...cut.size);
  }

  #hover(view, ray) {
    const point = ray && this.#under(view, ray);
    this.#say(point && this.#model(point), point);
  }

  /** The point of the domain, as it is drawn, that a view shows under the pointer. */
  #under(view, ray) {
    const { state, cut } = this;
    const amount = view === 0 ? 0 : state.amount;
    const [axis, at] = [state.axis, this.shared.clipAt.value];
    const hits = [];
    if (state.cutting) hits.push(this.pickedCut.hit(ray, amount, (point) => cut.isSolid(point)));
    if (state.boundary !== 'hidden') {
      hits.push(this.picked.hit(ray, amount, (point) => state.side * point[axis] <= at + 1e-6));
    }
    const [nearest] = hits.filter(Boolean).sort((a, b) => a.distance - b.distance);
    return nearest?.point;
  }

  #model(point) {
    const { centre, radius } = this.data.domain;
    return point.map((x, k) => centre[k] + radius * x);
  }

  /** Shows what the map does at a point that was typed. */
  #probe(point) {
    const { centre, radius } = this.data.domain;
    const drawn = point.map((x, k) => (x - centre[k]) / radius);
    if (isInside(drawn, this.surface.vertices, this.surface.indices)) this.#say(point, drawn);
    else {
      this.#say(undefined);
      this.readout.replaceChildren(element('p', {}, `(${point.join(', ')}) is outside the domain, where the map means nothing.`));
    }
  }

  /** What the map does at a point of the domain. */
  valuesAt(point) {
    const { data, arrays, lattice } = this;
    const { centre, radius } = data.target;
    const sampled = data.fields.map(({ key, palette }) => {
      const values = arrays[`field-${key}`];
      return [key, palette === 'labels' ? lattice.nearest(values, point) : lattice.sample(values, point)];
    });
    const interpolated = Object.fromEntries(sampled);
    if (!data.exact) {
      const image = [0, 1, 2].map((k) => centre[k] + radius * lattice.sample(arrays[`lattice-${k}`], point));
      return { image, ...interpolated };
    }
    const { image, jacobian } = evaluate(point, arrays.sources, arrays.coefficients, data.affine);
    const scaled = jacobian.map((row) => row.map((entry) => entry * data.scale));
    const sizes = stretches(jacobian);
    return {
      ...interpolated,
      image,
      jacobian,
      harmonic: harmonicDensity(scaled),
      deformation: deformationDensity(scaled, data.lame),
      volume: data.orientation * determinant(scaled),
      anisotropy: sizes[0] / sizes[2],
      determinant: determinant(jacobian),
    };
  }

  #say(point, drawn) {
    const markers = this.views.map(({ marker }) => marker);
    markers.forEach((marker) => { marker.visible = Boolean(point); });
    if (!point) {
      this.readout.replaceChildren(element('p', {}, 'Point at a solid to see where the map takes that point, and what it does there.'));
    } else {
      const values = this.valuesAt(point);
      const shown = (numbers) => `(${numbers.map((x) => significant(x, 8)).join(', ')})`;
      const entries = [['point', shown(point)], ['image', shown(values.image)]];
      for (const { key, label } of this.data.fields) entries.push([label, significant(values[key], 6)]);
      if (values.determinant !== undefined) entries.push(['det J', significant(values.determinant, 6)]);
      if (values.volume <= 0) entries.push(['folded', 'the map is not one to one around this point']);
      this.readout.replaceChildren(list(entries));
      const { centre, radius } = this.data.target;
      const image = values.image.map((x, k) => (x - centre[k]) / radius);
      markers[0].position.set(...drawn);
      markers[1].position.set(...drawn.map((x, k) => x + this.state.amount * (image[k] - x)));
    }
    this.stage.draw();
  }
}

/** Boxes with their centres and sides, seen through what is before them. */
function boxes(placed, colour, opacity) {
  const material = new MeshBasicMaterial({ transparent: true, opacity, depthTest: false });
  material.color.setRGB(...colour);
  const made = new InstancedMesh(new BoxGeometry(), material, placed.length / 4);
  const matrix = new Matrix4();
  for (let n = 0; n < placed.length / 4; n++) {
    const [x, y, z, side] = placed.subarray(4 * n, 4 * n + 4);
    made.setMatrixAt(n, matrix.makeScale(side, side, side).setPosition(x, y, z));
  }
  made.frustumCulled = false;
  return made;
}
