// What is under the pointer.

/** Corners of triangles somewhere between two places, as the views draw them. */
export class Morphed {
  constructor(from, to, indices) {
    Object.assign(this, { from, to, indices });
  }

  /** The nearest triangle along a ray that `accepts(triangle, weights)`, or nothing. */
  hit(ray, amount, accepts) {
    const { from, to, indices } = this;
    const [ox, oy, oz] = ray.origin.toArray();
    const [dx, dy, dz] = ray.direction.toArray();
    const keep = 1 - amount;
    let best;
    for (let t = 0; t < indices.length; t += 3) {
      const a = 3 * indices[t];
      const b = 3 * indices[t + 1];
      const c = 3 * indices[t + 2];
      const ax = keep * from[a] + amount * to[a];
      const ay = keep * from[a + 1] + amount * to[a + 1];
      const az = keep * from[a + 2] + amount * to[a + 2];
      const ux = keep * from[b] + amount * to[b] - ax;
      const uy = keep * from[b + 1] + amount * to[b + 1] - ay;
      const uz = keep * from[b + 2] + amount * to[b + 2] - az;
      const vx = keep * from[c] + amount * to[c] - ax;
      const vy = keep * from[c + 1] + amount * to[c + 1] - ay;
      const vz = keep * from[c + 2] + amount * to[c + 2] - az;
      // Möller & Trumbore, Fast, minimum storage ray/triangle intersection (1997).
      const px = dy * vz - dz * vy;
      const py = dz * vx - dx * vz;
      const pz = dx * vy - dy * vx;
      const determinant = ux * px + uy * py + uz * pz;
      if (determinant === 0) continue;
      const sx = ox - ax;
      const sy = oy - ay;
      const sz = oz - az;
      const second = (sx * px + sy * py + sz * pz) / determinant;
      if (!(second >= 0 && second <= 1)) continue;
      const qx = sy * uz - sz * uy;
      const qy = sz * ux - sx * uz;
      const qz = sx * uy - sy * ux;
      const third = (dx * qx + dy * qy + dz * qz) / determinant;
      if (!(third >= 0 && second + third <= 1)) continue;
      const distance = (vx * qx + vy * qy + vz * qz) / determinant;
      if (!(distance > 0) || (best && distance >= best.distance)) continue;
      const weights = [1 - second - third, second, third];
      const point = weighted(from, [a, b, c], weights);
      if (accepts(point)) best = { distance, point, triangle: t / 3, weights };
    }
    return best;
  }

  /** The point of a hit among other places of the same vertices. */
  weighted(points, { triangle, weights }) {
    const corners = [0, 1, 2].map((k) => 3 * this.indices[3 * triangle + k]);
    return weighted(points, corners, weights);
  }
}

function weighted(points, corners, weights) {
  return [0, 1, 2].map((k) => corners.reduce((sum, corner, n) => sum + weights[n] * points[corner + k], 0));
}

/** Whether a point is inside a closed surface: whether a ray meets it an odd number of times. */
export function isInside(point, vertices, indices) {
  // In no direction that edges of models like to have.
  const ray = { o: point, d: [0.8191, 0.4402, 0.3681] };
  let inside = false;
  for (let t = 0; t < indices.length; t += 3) {
    if (crosses(ray, vertices, 3 * indices[t], 3 * indices[t + 1], 3 * indices[t + 2])) inside = !inside;
  }
  return inside;
}

function crosses({ o, d }, p, a, b, c) {
  const u = [p[b] - p[a], p[b + 1] - p[a + 1], p[b + 2] - p[a + 2]];
  const v = [p[c] - p[a], p[c + 1] - p[a + 1], p[c + 2] - p[a + 2]];
  const s = [o[0] - p[a], o[1] - p[a + 1], o[2] - p[a + 2]];
  const h = cross(d, v);
  const determinant = dot(u, h);
  const second = dot(s, h) / determinant;
  const q = cross(s, u);
  const third = dot(d, q) / determinant;
  return second >= 0 && third >= 0 && second + third <= 1 && dot(v, q) / determinant > 0;
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
