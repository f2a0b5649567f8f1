// The page of a mesh of cells: whole cells are peeled off, and what is inverted stays.

import { BufferAttribute, BufferGeometry, DoubleSide, EdgesGeometry, LineBasicMaterial, LineSegments, Mesh, ShaderMaterial, Vector3 } from 'three';
import { SCALE_CODE, Scale, legend } from 'page/colours';
import { CutControls, boxOf } from 'page/cut-controls';
import { button, choice, element, group, list, significant, slider, tick } from 'page/elements';
import { histogram } from 'page/histogram';
import { Morphed } from 'page/pick';
import { Stage } from 'page/stage';

const NONE = 0xffffffff;
/** Degrees between faces at a feature edge, at least. */
const FEATURE = 40;
/** Corners of the faces, counter-clockwise seen from outside. */
const FACES = {
  tets: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
  hexes: [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
};
/** How far each corner of a face's triangles is from the sides of the face; the diagonal of a quad is no side. */
const RIMS = {
  3: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  4: [[1, 1, 0], [0, 1, 0], [0, 1, 1], [1, 0, 1], [0, 1, 1], [0, 0, 1]],
};
const TRIANGLES = { 3: [0, 1, 2], 4: [0, 1, 2, 0, 2, 3] };

const SHADER = {
  vertexShader: `
attribute float value;
attribute float wrong;
attribute vec3 rim;
varying float shown;
varying float isWrong;
varying vec3 side;
varying vec3 seen;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  shown = value;
  isWrong = wrong;
  side = rim;
  seen = place.xyz;
  gl_Position = projectionMatrix * place;
}`,
  fragmentShader: `
varying float shown;
varying float isWrong;
varying vec3 side;
varying vec3 seen;
uniform vec3 wrongColour;
uniform float edges;
${SCALE_CODE}
void main() {
  vec3 colour = isWrong > 0.5 ? wrongColour : scaleColour(shown);
  float light = 0.45 + 0.55 * abs(dot(normalize(cross(dFdx(seen), dFdy(seen))), normalize(seen)));
  vec3 near = side / max(fwidth(side), vec3(1e-6));
  float edge = edges * (1.0 - clamp(min(min(near.x, near.y), near.z) - 0.3, 0.0, 1.0));
  gl_FragColor = vec4(mix(colour * light, vec3(0.05), 0.75 * edge), 1.0);
}`,
};

const GHOST = {
  vertexShader: 'void main() { gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }',
  fragmentShader: 'void main() { gl_FragColor = vec4(vec3(0.5), 0.09); }',
};

export function showMesh(data, arrays) {
  return new MeshPage(data, arrays).element;
}

class MeshPage {
  constructor(data, arrays) {
    Object.assign(this, { data, arrays });
    this.fields = new Map(data.fields.map((field) => [field.key, field]));
    this.faces = FACES[data.cells];
    this.corners = data.cells === 'tets' ? 4 : 8;
    this.count = arrays.cells.length / this.corners;
    this.isInverted = new Uint8Array(this.count);
    for (const cell of arrays.inverted) this.isInverted[cell] = 1;
    this.middles = middles(arrays.nodes, arrays.cells, this.corners);
    this.box = boxOf(arrays.nodes, data.framing);
    this.stage = new Stage(['Mesh'], data.up);
    this.stage.show(arrays.nodes);
    this.state = {
      ...CutControls.start(this.stage, data.up), cutting: false, field: 'quality', range: [-Infinity, Infinity], depth: 0, edges: true, features: false, ghost: false,
    };
    this.#build();
    this.readout = element('div', { class: 'readout wide', 'aria-label': 'the cell under the pointer' });
    this.status = element('p', { class: 'legend', role: 'status' });
    this.stage.beforeDraw = () => this.#update();
    this.stage.onPointer((_, ray) => this.#hover(ray));
    this.stale = true;
    this.#say(undefined);
    this.element = element('div', { class: 'workbench' },
      element('div', {}, this.stage.element, this.readout), this.#controls());
    // For tests and the console: what is shown.
    window.solidmapPage = this;
  }

  #build() {
    const { data } = this;
    this.colourScale = new Scale(data.palettes);
    this.uniforms = {
      ...this.colourScale.uniforms,
      wrongColour: { value: new Vector3(...data.palettes.wrong).divideScalar(255) },
      edges: { value: 1 },
    };
    this.geometry = new BufferGeometry();
    // A little behind the lines that lie on it.
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    this.mesh = new Mesh(this.geometry, new ShaderMaterial({ ...SHADER, ...behind, uniforms: this.uniforms, side: DoubleSide }));
    this.ghost = new Mesh(this.#boundary(), new ShaderMaterial({ ...GHOST, transparent: true, depthWrite: false, side: DoubleSide }));
    for (const part of [this.mesh, this.ghost]) {
      part.frustumCulled = false;
      this.stage.views[0].scene.add(part);
    }
  }

  /** The whole boundary. */
  #boundary() {
    const indices = [];
    const { cells, neighbours, nodes } = this.arrays;
    this.faces.forEach((face, side) => {
      for (let cell = 0; cell < this.count; cell++) {
        if (neighbours[cell * this.faces.length + side] !== NONE) continue;
        for (const k of TRIANGLES[face.length]) indices.push(cells[cell * this.corners + face[k]]);
      }
    });
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(nodes, 3));
    geometry.setIndex(new BufferAttribute(new Uint32Array(indices), 1));
    return geometry;
  }

  /** The edges of the boundary where faces meet at an angle; made when they are first shown. */
  #features() {
    if (!this.features) {
      this.features = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: 0xe8590c }));
      this.features.frustumCulled = false;
      this.stage.views[0].scene.add(this.features);
    }
    if (this.state.features && !this.features.geometry.getAttribute('position')) {
      this.features.geometry = new EdgesGeometry(this.ghost.geometry, FEATURE);
    }
    return this.features;
  }

  #controls() {
    const { state, data } = this;
    const changed = (change) => {
      Object.assign(state, change);
      this.stale = true;
      this.stage.draw();
    };
    const fields = choice('by', data.fields.map(({ key, label }) => [key, label]), state.field, (field) => {
      changed({ field });
      this.legend.show(this.fields.get(field));
    });
    this.legend = legend(data.palettes, 'inverted: always shown');
    this.legend.show(this.fields.get(state.field));
    const quality = this.fields.get('quality');
    const bars = histogram(this.arrays['field-quality'], quality, data.palettes.quality, (range) => changed({ range: [...range] }));
    const depth = slider('at least', {
      max: data.deepest, step: data.deepest / 200 || 1, value: 0, shown: (value) => significant(value, 3),
    }, (value) => changed({ depth: value }));
    this.plane = new CutControls(this, data.framing.radius, () => changed({}));
    return element('div', { class: 'controls' },
      group('Colour', fields.element, this.legend.element),
      group('Scaled Jacobian', ...bars.elements),
      group('Depth', depth.element),
      this.plane.element,
      group('Show', tick('edges', true, (edges) => changed({ edges })).element,
        tick('feature edges', false, (features) => changed({ features })).element,
        tick('boundary as a shadow', false, (ghost) => changed({ ghost })).element, this.status),
      element('div', { class: 'row' },
        button('Save picture', () => this.stage.save('solidmap.png')),
        button('First view', () => this.stage.home())));
  }

  /** Which cells are shown: those in all ranges, and all that are inverted. */
  shown() {
    const { state, arrays, middles: at, isInverted } = this;
    const [quality, depth] = [arrays['field-quality'], arrays['field-depth']];
    const [from, to] = state.range.map((end) => Math.fround(end));
    const { centre, radius } = this.data.framing;
    const plane = (this.plane.coordinate() - centre[state.axis]) / radius;
    const shown = new Uint8Array(this.count);
    for (let cell = 0; cell < this.count; cell++) {
      const is = quality[cell] >= from && quality[cell] <= to && depth[cell] >= state.depth
        && (!state.cutting || state.side * at[3 * cell + state.axis] <= state.side * plane);
      shown[cell] = is || isInverted[cell] ? 1 : 0;
    }
    return shown;
  }

  #update() {
    if (!this.stale) return;
    this.stale = false;
    const { state, arrays, uniforms } = this;
    const field = this.fields.get(state.field);
    this.colourScale.use(field);
    uniforms.edges.value = state.edges ? 1 : 0;
    this.ghost.visible = state.ghost;
    this.#features().visible = state.features;
    const shown = this.shown();
    this.#skin(shown, arrays[`field-${state.field}`]);
    const cells = shown.reduce((sum, is) => sum + is, 0);
    this.status.textContent = `${cells} of ${this.count} ${this.data.elements} are shown; ${arrays.inverted.length} are inverted.`;
  }

  /** The faces between cells that are shown and others. */
  #skin(shown, values) {
    const { faces, corners, count, isInverted } = this;
    const { cells, neighbours, nodes } = this.arrays;
    const sides = faces.length;
    const open = [];
    for (let cell = 0; cell < count; cell++) {
      if (!shown[cell]) continue;
      for (let side = 0; side < sides; side++) {
        const other = neighbours[cell * sides + side];
        if (other === NONE || !shown[other]) open.push(cell * sides + side);
      }
    }
    const size = faces[0].length;
    const [triangles, rims] = [TRIANGLES[size], RIMS[size]];
    const total = open.length * triangles.length;
    const position = new Float32Array(3 * total);
    const rim = new Uint8Array(3 * total);
    const value = new Float32Array(total);
    const wrong = new Uint8Array(total);
    this.pickNodes = new Uint32Array(total);
    this.pickCells = new Uint32Array(total / 3);
    let v = 0;
    for (const face of open) {
      const cell = Math.floor(face / sides);
      const own = faces[face % sides];
      for (let k = 0; k < triangles.length; k++, v++) {
        const node = cells[cell * corners + own[triangles[k]]];
        position[3 * v] = nodes[3 * node];
        position[3 * v + 1] = nodes[3 * node + 1];
        position[3 * v + 2] = nodes[3 * node + 2];
        rim[3 * v] = rims[k][0];
        rim[3 * v + 1] = rims[k][1];
        rim[3 * v + 2] = rims[k][2];
        value[v] = values[cell];
        wrong[v] = isInverted[cell];
        this.pickNodes[v] = node;
        if (k % 3 === 0) this.pickCells[v / 3] = cell;
      }
    }
    this.geometry.dispose();
    this.geometry.setAttribute('position', new BufferAttribute(position, 3));
    this.geometry.setAttribute('rim', new BufferAttribute(rim, 3));
    this.geometry.setAttribute('value', new BufferAttribute(value, 1));
    this.geometry.setAttribute('wrong', new BufferAttribute(wrong, 1));
    this.mesh.visible = total > 0;
  }

  #hover(ray) {
    const { nodes } = this.arrays;
    const hit = ray && new Morphed(nodes, nodes, this.pickNodes).hit(ray, 0, () => true);
    this.#say(hit && this.pickCells[hit.triangle]);
  }

  #say(cell) {
    if (cell === undefined) {
      this.readout.replaceChildren(element('p', {}, 'Point at a cell to see its number and its values.'));
      return;
    }
    const { centre, radius } = this.data.framing;
    const middle = [0, 1, 2].map((k) => significant(centre[k] + radius * this.middles[3 * cell + k], 6));
    const entries = [['cell (from 0)', String(cell)], ['middle', `(${middle.join(', ')})`]];
    for (const { key, label } of this.data.fields) entries.push([label, significant(this.arrays[`field-${key}`][cell], 6)]);
    if (this.isInverted[cell]) entries.push(['inverted', 'yes']);
    this.readout.replaceChildren(list(entries));
  }
}

/** The mean of each cell's corners. */
function middles(nodes, cells, corners) {
  const found = new Float32Array((3 * cells.length) / corners);
  for (let n = 0; n < cells.length; n++) {
    const at = 3 * Math.floor(n / corners);
    for (let k = 0; k < 3; k++) found[at + k] += nodes[3 * cells[n] + k] / corners;
  }
  return found;
}
