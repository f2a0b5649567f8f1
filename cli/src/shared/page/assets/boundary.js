// The page of a boundary map: the domain's surface and its image, with one pattern, or coloured by how far triangles are
// distorted. An image in the plane z = 0 is seen from above.

import {
  BufferAttribute, BufferGeometry, DoubleSide, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, ShaderMaterial, SphereGeometry, Vector3,
} from 'three';
import { SCALE_CODE, Scale, legend } from 'page/colours';
import { button, choice, element, group, list, remark, significant, slider } from 'page/elements';
import { CHECKER_CODE } from 'page/map-shaders';
import { Morphed } from 'page/pick';
import { Stage } from 'page/stage';

const PATTERNS = [['coloured', 'checker, coloured by place'], ['checker', 'checker']];

const SHADER = {
  vertexShader: `
attribute vec3 image;
attribute float value;
attribute float wrong;
uniform float amount;
varying vec3 domain;
varying vec3 seen;
varying float shown;
varying float isWrong;
void main() {
  isWrong = wrong;
  vec4 place = modelViewMatrix * vec4(mix(position, image, amount), 1.0);
  domain = position;
  seen = place.xyz;
  shown = value;
  gl_Position = projectionMatrix * place;
}`,
  fragmentShader: `
varying vec3 domain;
varying vec3 seen;
varying float shown;
varying float isWrong;
uniform int pattern;
uniform vec3 wrongColour;
${SCALE_CODE}
${CHECKER_CODE}
void main() {
  float facing = abs(dot(normalize(cross(dFdx(seen), dFdy(seen))), normalize(seen)));
  vec3 colour = isWrong > 0.5 ? wrongColour : pattern == 0 ? scaleColour(shown) : checkerColour(domain, pattern == 2);
  float light = gl_FrontFacing ? 0.4 + 0.6 * facing : 0.3 + 0.25 * facing;
  gl_FragColor = vec4(colour * light, 1.0);
}`,
};

export function showBoundary(data, arrays) {
  return new BoundaryPage(data, arrays).element;
}

class BoundaryPage {
  constructor(data, arrays) {
    Object.assign(this, { data, arrays });
    this.fields = new Map(data.fields.map((field) => [field.key, field]));
    this.picked = new Morphed(arrays.domain, arrays.image, arrays.triangles);
    [this.domainName, this.imageName] = data.names;
    this.stage = new Stage(data.names.map(capitalised), data.up);
    this.stage.show(arrays.domain, data.flat ? turned(arrays.image, this.stage.camera.quaternion) : arrays.image);
    this.state = { colour: 'coloured', amount: 1 };
    this.stale = true;
    this.#build();
    this.readout = element('div', { class: 'readout wide', 'aria-label': 'the point under the pointer' });
    this.stage.beforeDraw = () => this.#update();
    this.stage.onPointer((view, ray) => this.#hover(view, ray));
    this.#say(undefined);
    this.element = element('div', { class: 'workbench' },
      element('div', {}, this.stage.element, this.readout), this.#controls());
    // For tests and the console: what is shown.
    window.solidmapPage = this;
  }

  #build() {
    const { domain, image, triangles } = this.arrays;
    // Every triangle has corners of its own, so that it has one value.
    const corners = (points) => {
      const found = new Float32Array(3 * triangles.length);
      triangles.forEach((vertex, n) => found.set(points.subarray(3 * vertex, 3 * vertex + 3), 3 * n));
      return new BufferAttribute(found, 3);
    };
    this.geometry = new BufferGeometry();
    this.geometry.setAttribute('position', corners(domain));
    this.geometry.setAttribute('image', corners(image));
    this.geometry.setAttribute('value', new BufferAttribute(new Float32Array(triangles.length), 1));
    const wrong = new Uint8Array(triangles.length);
    for (const triangle of this.arrays.flipped) wrong.fill(1, 3 * triangle, 3 * triangle + 3);
    this.geometry.setAttribute('wrong', new BufferAttribute(wrong, 1));
    const [low, high] = [new Vector3().setScalar(Infinity), new Vector3().setScalar(-Infinity)];
    for (let n = 0; n < domain.length; n += 3) {
      const point = new Vector3().fromArray(domain, n);
      low.min(point);
      high.max(point);
    }
    this.colourScale = new Scale(this.data.palettes);
    this.shared = {
      pattern: { value: 2 },
      wrongColour: { value: new Vector3(...this.data.palettes.wrong).divideScalar(255) },
      low: { value: low },
      extent: { value: high.sub(low) },
      ...this.colourScale.uniforms,
    };
    this.views = this.stage.views.map(({ scene }, number) => {
      const uniforms = { ...this.shared, amount: { value: number } };
      const surface = new Mesh(this.geometry, new ShaderMaterial({ ...SHADER, uniforms, side: DoubleSide }));
      const marker = new Mesh(new SphereGeometry(0.016), new MeshBasicMaterial({ color: 0xff2020, depthTest: false }));
      marker.renderOrder = 1;
      for (const part of [surface, marker]) {
        part.frustumCulled = false;
        scene.add(part);
      }
      return { marker, uniforms };
    });
    if (this.data.flat) this.outline = this.#outline();
  }

  /** Lines over the image. They lie in its triangles, so that they are not hidden by these. */
  #outline() {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(this.arrays.outline, 3));
    const outline = new LineSegments(geometry, new LineBasicMaterial({ color: 0x141414, depthTest: false }));
    outline.frustumCulled = false;
    this.stage.views[1].scene.add(outline);
    return outline;
  }

  #controls() {
    const { state, data } = this;
    const options = [...PATTERNS, ...data.fields.map(({ key, label }) => [key, label])];
    const colours = choice('by', options, state.colour, (colour) => {
      state.colour = colour;
      this.stale = true;
      this.#legend();
      this.stage.draw();
    });
    this.scale = element('div');
    const morph = slider('move', {
      value: 1, step: 0.01,
      shown: (value) => {
        if (value === 1) return `at the ${this.imageName}`;
        return value === 0 ? `at the ${this.domainName}` : `${Math.round(100 * value)} % of the way`;
      },
    }, (amount) => {
      state.amount = amount;
      this.stage.draw();
    });
    this.#legend();
    return element('div', { class: 'controls' },
      group('Colour', colours.element, this.scale),
      group(capitalised(this.imageName), morph.element,
        remark('Points move to their images along straight lines, with both surfaces scaled to one size.'),
        data.flat ? remark(`The ${this.imageName} is seen from above, however the ${this.domainName} is turned.`) : undefined),
      element('div', { class: 'row' },
        button('Save picture', () => this.stage.save('solidmap.png')),
        button('First view', () => this.stage.home())));
  }

  #legend() {
    const field = this.fields.get(this.state.colour);
    if (!field) {
      const words = `The same pattern on both: cubes of the ${this.domainName}’s box, and where they go.${this.#wrongWords()}`;
      this.scale.replaceChildren(element('p', { class: 'legend' }, words));
      return;
    }
    const shown = legend(this.data.palettes, this.arrays.flipped.length ? 'inverted image' : undefined);
    shown.show(field);
    this.scale.replaceChildren(shown.element);
  }

  #wrongWords() {
    return this.arrays.flipped.length ? ' Magenta: triangles whose images are inverted.' : '';
  }

  #update() {
    const { state, shared } = this;
    const { text, scene } = this.stage.views[1];
    this.views[1].uniforms.amount.value = state.amount;
    text.textContent = state.amount === 1
      ? capitalised(this.imageName) : `${Math.round(100 * state.amount)} % of the way to the ${this.imageName}`;
    if (this.outline) {
      // The plane faces the camera; on the way to it, triangles turn as they move.
      scene.quaternion.identity().slerp(this.stage.camera.quaternion, state.amount);
      this.outline.visible = state.amount === 1;
    }
    if (!this.stale) return;
    this.stale = false;
    const field = this.fields.get(state.colour);
    shared.pattern.value = { checker: 1, coloured: 2 }[state.colour] ?? 0;
    if (!field) return;
    const values = this.geometry.getAttribute('value');
    this.arrays[`field-${field.key}`].forEach((value, triangle) => values.array.fill(value, 3 * triangle, 3 * triangle + 3));
    values.needsUpdate = true;
    this.colourScale.use(field);
  }

  #hover(view, ray) {
    this.#say(ray && this.picked.hit(ray, view === 0 ? 0 : this.state.amount, () => true));
  }

  #say(hit) {
    for (const { marker } of this.views) marker.visible = Boolean(hit);
    if (hit) {
      const { domain, target, fields } = this.data;
      const shown = (point, { centre, radius }) => `(${point.map((x, k) => significant(centre[k] + radius * x, 7)).join(', ')})`;
      const image = this.picked.weighted(this.arrays.image, hit);
      const entries = [['point', shown(hit.point, domain)], [this.imageName, shown(image, target)], ['triangle (from 0)', String(hit.triangle)]];
      for (const { key, label } of fields) entries.push([label, significant(this.arrays[`field-${key}`][hit.triangle], 5)]);
      this.readout.replaceChildren(list(entries));
      const { amount } = this.state;
      this.views[0].marker.position.set(...hit.point);
      this.views[1].marker.position.set(...hit.point.map((x, k) => x + amount * (image[k] - x)));
    } else {
      this.readout.replaceChildren(element('p', {}, 'Point at a surface to see where the map takes that point.'));
    }
    this.stage.draw();
  }
}

function capitalised(name) {
  return name[0].toUpperCase() + name.slice(1);
}

/** Points turned about the origin. */
function turned(points, quaternion) {
  const found = new Float32Array(points.length);
  const point = new Vector3();
  for (let k = 0; k < points.length; k += 3) point.fromArray(points, k).applyQuaternion(quaternion).toArray(found, k);
  return found;
}
