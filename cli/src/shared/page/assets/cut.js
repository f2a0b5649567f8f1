// A cut across an axis of the domain, and the same cut carried by the map.
//
// The cut is a mesh of squares, half as large as the cubes of the lattice, over the whole plane: their corners have images and
// values interpolated between the samples. What of it belongs to the solid is said by a mask, the section of the domain's
// boundary drawn to a picture, so that its edge is sharp however coarse the lattice is, in the target too.

import { DataTexture, FloatType, RedFormat } from 'three';

/** Texels of the mask along its longer side. */
const MASK = 1024;
/** Squares along the side of a cube of the lattice. */
const FINER = 2;

export class Lattice {
  /** `columns` are arrays with a value for each node, NaN where there is none. */
  constructor({ low, step, counts }) {
    Object.assign(this, { low, step, counts });
  }

  /** Nodes around a point with their weights; those without weight are left out. */
  around(point) {
    const [nx, ny] = this.counts;
    const cell = [0, 1, 2].map((k) => {
      const place = (point[k] - this.low[k]) / this.step;
      const index = Math.min(Math.max(Math.floor(place), 0), this.counts[k] - 2);
      return [index, Math.min(Math.max(place - index, 0), 1)];
    });
    const around = [];
    for (let corner = 0; corner < 8; corner++) {
      const far = [corner & 1, (corner >> 1) & 1, corner >> 2];
      const weight = far.reduce((product, is, k) => product * (is ? cell[k][1] : 1 - cell[k][1]), 1);
      const [i, j, l] = far.map((is, k) => cell[k][0] + is);
      if (weight > 0) around.push([i + nx * (j + ny * l), weight]);
    }
    return around;
  }

  /** A value at a point. */
  sample(values, point) {
    return this.around(point).reduce((sum, [node, weight]) => sum + weight * values[node], 0);
  }

  /** The value at the node nearest to a point. */
  nearest(values, point) {
    const [node] = this.around(point).reduce((best, next) => (next[1] > best[1] ? next : best));
    return values[node];
  }

  /** The box: lowest corner and extent. */
  extent(k) {
    return this.step * (this.counts[k] - 1);
  }
}

export class Cut {
  /**
   * @param lattice the lattice
   * @param images the images' coordinates at its nodes, three arrays; without them, the cut stays where it is
   * @param surface `vertices`, `images` and `indices` of the boundary, as they are drawn
   * @param framing how points of the domain are drawn: `(p − centre) / radius`
   */
  constructor(lattice, images, surface, framing) {
    Object.assign(this, { lattice, images, surface, framing });
  }

  /** Cuts across an axis, at a coordinate of the domain. */
  at(axis, coordinate) {
    const { lattice } = this;
    this.axis = axis;
    this.coordinate = coordinate;
    this.axes = [(axis + 1) % 3, (axis + 2) % 3];
    const [u, v] = this.axes;
    this.size = [u, v].map((k) => FINER * (lattice.counts[k] - 1) + 1);
    const [nu, nv] = this.size;
    const strides = [1, lattice.counts[0], lattice.counts[0] * lattice.counts[1]];
    const layer = Math.min(Math.max((coordinate - lattice.low[axis]) / lattice.step, 0), lattice.counts[axis] - 1);
    const below = Math.min(Math.floor(layer), lattice.counts[axis] - 2);
    // The nodes and weights of each corner: the same for all values that are interpolated.
    this.nodes = new Uint32Array(8 * nu * nv);
    this.weights = new Float32Array(8 * nu * nv);
    const along = (n) => [Math.min(Math.floor(n / FINER), Number.MAX_SAFE_INTEGER), (n % FINER) / FINER];
    for (let j = 0, at = 0; j < nv; j++) {
      const [vNode, vShare] = along(j);
      for (let i = 0; i < nu; i++, at += 8) {
        const [uNode, uShare] = along(i);
        const base = uNode * strides[u] + vNode * strides[v] + below * strides[axis];
        for (let corner = 0; corner < 8; corner++) {
          const [fu, fv, fa] = [corner & 1, (corner >> 1) & 1, corner >> 2];
          const weight = (fu ? uShare : 1 - uShare) * (fv ? vShare : 1 - vShare) * (fa ? layer - below : 1 - layer + below);
          this.weights[at + corner] = weight;
          this.nodes[at + corner] = weight > 0 ? base + fu * strides[u] + fv * strides[v] + fa * strides[axis] : 0;
        }
      }
    }
    this.#place();
    this.#section();
  }

  /** Values at the corners of the squares. */
  interpolated(values) {
    const [nu, nv] = this.size;
    const { nodes, weights } = this;
    const found = new Float32Array(nu * nv);
    for (let n = 0; n < found.length; n++) {
      let sum = 0;
      for (let k = 8 * n; k < 8 * n + 8; k++) {
        if (weights[k] > 0) sum += weights[k] * values[nodes[k]];
      }
      found[n] = sum;
    }
    return found;
  }

  /** Of the samples around each corner of the squares, the value of the nearest: labels have no values between them. */
  nearest(values) {
    const [nu, nv] = this.size;
    const { nodes, weights } = this;
    const found = Float32Array.from({ length: nu * nv }, (_, n) => {
      let best = 8 * n;
      for (let k = 8 * n; k < 8 * n + 8; k++) if (weights[k] > weights[best]) best = k;
      return values[nodes[best]];
    });
    const texture = new DataTexture(found, nu, nv, RedFormat, FloatType);
    texture.needsUpdate = true;
    return texture;
  }

  #place() {
    const { lattice, framing } = this;
    const [u, v] = this.axes;
    const [nu, nv] = this.size;
    this.domain = new Float32Array(3 * nu * nv);
    this.uv = new Float32Array(2 * nu * nv);
    const placed = (k, x) => (x - framing.centre[k]) / framing.radius;
    for (let j = 0, n = 0; j < nv; j++) {
      for (let i = 0; i < nu; i++, n++) {
        this.domain[3 * n + u] = placed(u, lattice.low[u] + (i / FINER) * lattice.step);
        this.domain[3 * n + v] = placed(v, lattice.low[v] + (j / FINER) * lattice.step);
        this.domain[3 * n + this.axis] = placed(this.axis, this.coordinate);
        this.uv[2 * n] = i / (nu - 1);
        this.uv[2 * n + 1] = j / (nv - 1);
      }
    }
    this.image = this.images ? this.#carried() : this.domain;
    const has = (n) => !Number.isNaN(this.image[3 * n]);
    const indices = [];
    for (let j = 0; j + 1 < nv; j++) {
      for (let i = 0; i + 1 < nu; i++) {
        const a = i + nu * j;
        if (has(a) && has(a + 1) && has(a + nu) && has(a + nu + 1)) indices.push(a, a + 1, a + nu + 1, a, a + nu + 1, a + nu);
      }
    }
    this.indices = new Uint32Array(indices);
  }

  /** The images of the corners. */
  #carried() {
    const coordinates = this.images.map((values) => this.interpolated(values));
    const image = new Float32Array(3 * coordinates[0].length);
    for (let n = 0; n < coordinates[0].length; n++) for (let k = 0; k < 3; k++) image[3 * n + k] = coordinates[k][n];
    return image;
  }

  /** The section of the boundary: its segments, in the domain and in the target, and the mask. */
  #section() {
    const { vertices, images, indices } = this.surface;
    const { axis, axes: [u, v], framing, lattice } = this;
    const plane = (this.coordinate - framing.centre[axis]) / framing.radius;
    const [from, to] = [[], []];
    for (let t = 0; t < indices.length; t += 3) {
      const corners = [3 * indices[t], 3 * indices[t + 1], 3 * indices[t + 2]];
      const above = corners.map((corner) => vertices[corner + axis] >= plane);
      if (above[0] === above[1] && above[1] === above[2]) continue;
      for (let k = 0; k < 3; k++) {
        const [a, b] = [corners[k], corners[(k + 1) % 3]];
        if (above[k] === above[(k + 1) % 3]) continue;
        const share = (plane - vertices[a + axis]) / (vertices[b + axis] - vertices[a + axis]);
        for (let c = 0; c < 3; c++) {
          from.push(vertices[a + c] + share * (vertices[b + c] - vertices[a + c]));
          to.push(images[a + c] + share * (images[b + c] - images[a + c]));
        }
      }
    }
    this.outline = { from: new Float32Array(from), to: new Float32Array(to) };
    const longest = Math.max(lattice.extent(u), lattice.extent(v));
    const texels = [u, v].map((k) => Math.max(1, Math.round((MASK * lattice.extent(k)) / longest)));
    const onto = (k, n) => (x) => ((x * framing.radius + framing.centre[k] - lattice.low[k]) / lattice.extent(k)) * texels[n];
    this.mask = filled(from, [u, v], [onto(u, 0), onto(v, 1)], texels);
    this.maskSize = texels;
  }

  /** Whether a point of the plane, as it is drawn in the domain, belongs to the solid. */
  isSolid(point) {
    const [u, v] = this.axes;
    const [column, row] = [u, v].map((k, n) => {
      const place = (point[k] * this.framing.radius + this.framing.centre[k] - this.lattice.low[k]) / this.lattice.extent(k);
      return Math.min(Math.max(Math.floor(place * this.maskSize[n]), 0), this.maskSize[n] - 1);
    });
    return this.mask[column + this.maskSize[0] * row] >= 128;
  }
}

/** The inside of closed outlines as a picture: how much of each texel in the middle of its row is inside. */
function filled(segments, [u, v], [across, up], [width, height]) {
  const rows = Array.from({ length: height }, () => []);
  for (let s = 0; s < segments.length; s += 6) {
    const [x0, y0] = [across(segments[s + u]), up(segments[s + v])];
    const [x1, y1] = [across(segments[s + 3 + u]), up(segments[s + 3 + v])];
    const [first, last] = [Math.ceil(Math.min(y0, y1) - 0.5), Math.ceil(Math.max(y0, y1) - 0.5)];
    for (let row = Math.max(first, 0); row < Math.min(last, height); row++) {
      rows[row].push(x0 + ((row + 0.5 - y0) / (y1 - y0)) * (x1 - x0));
    }
  }
  const mask = new Uint8Array(width * height);
  rows.forEach((crossings, row) => {
    crossings.sort((a, b) => a - b);
    for (let k = 0; k + 1 < crossings.length; k += 2) {
      const [begin, end] = [Math.max(crossings[k], 0), Math.min(crossings[k + 1], width)];
      for (let column = Math.floor(begin); column < end; column++) {
        const covered = Math.min(end, column + 1) - Math.max(begin, column);
        mask[row * width + column] = Math.min(255, mask[row * width + column] + Math.round(255 * covered));
      }
    }
  });
  return mask;
}
