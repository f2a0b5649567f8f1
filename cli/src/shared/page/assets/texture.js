// The page of a solid texture: the coloured surface, cut anywhere.

import {
  BufferAttribute, BufferGeometry, Data3DTexture, DoubleSide, LineSegments, LinearFilter, Mesh, MeshBasicMaterial, RGBAFormat, ShaderMaterial, SphereGeometry,
  UnsignedByteType, Vector3,
} from 'three';
import { replaceCut } from 'page/buffers';
import { Cut, Lattice } from 'page/cut';
import { CutControls, boxOf } from 'page/cut-controls';
import { button, choice, element, group, list, remark, significant, triple } from 'page/elements';
import { LINE_SHADER } from 'page/map-shaders';
import { Morphed, isInside } from 'page/pick';
import { Stage } from 'page/stage';

const AXES = ['x', 'y', 'z'];
const SURFACES = [['lit', 'lit'], ['flat', 'colours as they are'], ['hidden', 'hidden']];
/** Cells of the lattice that a cut is drawn on: its colours are looked up in each pixel. */
const CELLS = 4;

const VERTEX = `
varying vec3 domain;
varying vec3 seen;
varying vec2 place;
void main() {
  vec4 moved = modelViewMatrix * vec4(position, 1.0);
  domain = position;
  seen = moved.xyz;
  place = uv;
  gl_Position = projectionMatrix * moved;
}`;

const SURFACE = {
  vertexShader: VERTEX.replace('void main() {', 'attribute vec3 colour;\nvarying vec3 painted;\nvoid main() {\n  painted = colour;'),
  fragmentShader: `
varying vec3 domain;
varying vec3 seen;
varying vec3 painted;
uniform vec3 clipAxis;
uniform float clipAt;
uniform bool lit;
void main() {
  if (dot(domain, clipAxis) > clipAt) discard;
  float facing = abs(dot(normalize(cross(dFdx(seen), dFdy(seen))), normalize(seen)));
  float light = !lit ? 1.0 : gl_FrontFacing ? 0.35 + 0.65 * facing : 0.30 + 0.25 * facing;
  gl_FragColor = vec4(painted * light, 1.0);
}`,
};

const PLANE = {
  vertexShader: VERTEX,
  fragmentShader: `
varying vec3 domain;
varying vec2 place;
uniform sampler2D mask;
uniform sampler3D voxels;
uniform vec3 first;
uniform vec3 extent;
void main() {
  if (texture2D(mask, place).r < 0.5) discard;
  gl_FragColor = vec4(texture(voxels, (domain - first) / extent).rgb, 1.0);
}`,
};

export function showTexture(data, arrays) {
  return new TexturePage(data, arrays).element;
}

class TexturePage {
  constructor(data, arrays) {
    Object.assign(this, { data, arrays });
    const { surface, triangles } = arrays;
    this.picked = new Morphed(surface, surface, triangles);
    this.box = boxOf(surface, data.domain);
    const step = Math.max(...[0, 1, 2].map((k) => this.box[1][k] - this.box[0][k])) / CELLS;
    const counts = [0, 1, 2].map((k) => Math.max(1, Math.ceil((this.box[1][k] - this.box[0][k]) / step)) + 1);
    const lattice = new Lattice({ low: this.box[0], step, counts });
    this.cut = new Cut(lattice, undefined, { vertices: surface, images: surface, indices: triangles }, data.domain);
    this.stage = new Stage(['Solid texture'], data.up);
    this.stage.show(surface);
    this.state = { ...CutControls.start(this.stage, data.up), shown: 'lit' };
    this.#build();
    this.readout = element('div', { class: 'readout wide', 'aria-label': 'the colour at a point' });
    this.stage.onPointer((view, ray) => this.#say(ray && this.#under(ray)));
    this.stage.beforeDraw = () => this.#update();
    this.moved = true;
    this.element = element('div', { class: 'workbench' },
      element('div', {}, this.stage.element, this.readout), this.#controls());
    this.#say(undefined);
    // For tests and the console: where things are, and what they are.
    window.solidmapPage = this;
  }

  #build() {
    const { arrays, data: { domain: { centre, radius }, voxels } } = this;
    const drawn = (point) => new Vector3(...point.map((x, k) => (x - centre[k]) / radius));
    const surface = new BufferGeometry();
    surface.setAttribute('position', new BufferAttribute(arrays.surface, 3));
    surface.setAttribute('colour', new BufferAttribute(arrays.colours, 3, true));
    surface.setIndex(new BufferAttribute(arrays.triangles, 1));
    const texture = new Data3DTexture(arrays.voxels, ...voxels.size);
    Object.assign(texture, { format: RGBAFormat, type: UnsignedByteType, minFilter: LinearFilter, magFilter: LinearFilter, needsUpdate: true });
    // Voxels are sampled at their centres.
    const first = voxels.origin.map((x) => x - voxels.spacing / 2);
    this.uniforms = {
      clipAxis: { value: new Vector3() },
      clipAt: { value: 0 },
      lit: { value: true },
      mask: { value: null },
      voxels: { value: texture },
      first: { value: drawn(first) },
      extent: { value: new Vector3(...voxels.size).multiplyScalar(voxels.spacing / radius) },
      amount: { value: 0 },
      line: { value: new Vector3() },
    };
    const made = (shader) => new ShaderMaterial({ ...shader, uniforms: this.uniforms, side: DoubleSide });
    this.surface = new Mesh(surface, made(SURFACE));
    this.plane = new Mesh(new BufferGeometry(), made(PLANE));
    this.outline = new LineSegments(new BufferGeometry(), made(LINE_SHADER));
    this.marker = new Mesh(new SphereGeometry(0.012), new MeshBasicMaterial({ color: 0xff2020, depthTest: false }));
    this.marker.renderOrder = 1;
    for (const part of [this.surface, this.plane, this.outline, this.marker]) {
      part.frustumCulled = false;
      this.stage.views[0].scene.add(part);
    }
  }

  #controls() {
    const { state, data } = this;
    this.controls = new CutControls(this, data.domain.radius, (moved) => {
      this.moved ||= moved;
      this.stage.draw();
    });
    const shown = choice('drawn', SURFACES, state.shown, (how) => {
      state.shown = how;
      this.stage.draw();
    });
    return element('div', { class: 'controls' },
      this.controls.element,
      group('Surface', shown.element, remark('The colours of a cut are those of the texture, without light.')),
      group('A point of the solid', triple('point', AXES, (point) => this.#probe(point))),
      element('div', { class: 'row' },
        button('Save picture', () => this.stage.save('solidmap.png')),
        button('First view', () => this.stage.home())));
  }

  /** Brings what is drawn up to date. */
  #update() {
    const { state, uniforms, cut } = this;
    if (this.moved) {
      cut.at(state.axis, this.controls.coordinate());
      uniforms.mask.value?.dispose();
      uniforms.mask.value = replaceCut(cut, this.plane.geometry, this.outline.geometry);
      this.pickedCut = new Morphed(cut.domain, cut.domain, cut.indices);
      this.moved = false;
    }
    const { centre, radius } = this.data.domain;
    const at = (this.controls.coordinate() - centre[state.axis]) / radius;
    uniforms.clipAxis.value.set(0, 0, 0).setComponent(state.axis, state.side);
    uniforms.clipAt.value = state.cutting ? state.side * at : 1e9;
    uniforms.lit.value = state.shown === 'lit';
    uniforms.line.value.setScalar(0.08);
    this.surface.visible = state.shown !== 'hidden';
    this.plane.visible = state.cutting && cut.indices.length > 0;
    this.outline.visible = state.cutting;
  }

  /** The point, as it is drawn, that the view shows under the pointer. */
  #under(ray) {
    const { state, cut } = this;
    const hits = [];
    if (state.cutting && this.pickedCut) hits.push(this.pickedCut.hit(ray, 0, (point) => cut.isSolid(point)));
    if (this.surface.visible) hits.push(this.picked.hit(ray, 0, (point) => state.side * point[state.axis] <= this.uniforms.clipAt.value + 1e-6));
    const [nearest] = hits.filter(Boolean).sort((a, b) => a.distance - b.distance);
    return nearest?.point;
  }

  /** Shows the colour at a point that was typed. */
  #probe(point) {
    const { centre, radius } = this.data.domain;
    const drawn = point.map((x, k) => (x - centre[k]) / radius);
    if (isInside(drawn, this.arrays.surface, this.arrays.triangles)) this.#say(drawn);
    else {
      this.#say(undefined);
      this.readout.replaceChildren(element('p', {}, `(${point.join(', ')}) is outside the solid.`));
    }
  }

  /** The colour of the voxel that a point of the solid is in. */
  colourAt(point) {
    const { origin, spacing, size } = this.data.voxels;
    const [i, j, k] = size.map((n, axis) => Math.min(Math.max(Math.round((point[axis] - origin[axis]) / spacing), 0), n - 1));
    const at = 4 * (i + size[0] * (j + size[1] * k));
    return [...this.arrays.voxels.subarray(at, at + 3)];
  }

  #say(drawn) {
    this.marker.visible = Boolean(drawn);
    if (drawn) {
      const { centre, radius } = this.data.domain;
      const point = drawn.map((x, k) => centre[k] + radius * x);
      const colour = this.colourAt(point);
      const swatch = element('span', { class: 'swatch', style: `background: rgb(${colour.join(' ')})` });
      this.readout.replaceChildren(list([
        ['point', `(${point.map((x) => significant(x, 7)).join(', ')})`],
        ['red, green, blue', element('span', {}, swatch, ` ${colour.join(', ')}`)],
      ]));
      this.marker.position.set(...drawn);
    } else {
      this.readout.replaceChildren(element('p', {}, 'Point at the solid to see the colour of the texture there.'));
    }
    this.stage.draw();
  }
}
