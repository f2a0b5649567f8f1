// The harmonic map itself, summed over its sources, and what a Jacobian says.

/** `f(x) = affine · (1, x) + Σ c / (4π |x − s|)`, with its Jacobian by rows: `J[i][k] = ∂f_i / ∂x_k`. */
export function evaluate(point, sources, coefficients, affine) {
  const [x, y, z] = point;
  const image = [0, 1, 2].map((i) => affine[0][i] + x * affine[1][i] + y * affine[2][i] + z * affine[3][i]);
  const jacobian = [0, 1, 2].map((i) => [affine[1][i], affine[2][i], affine[3][i]]);
  const sums = new Float64Array(12);
  for (let s = 0; s < sources.length; s += 3) {
    const dx = x - sources[s];
    const dy = y - sources[s + 1];
    const dz = z - sources[s + 2];
    const inverse = 1 / Math.sqrt(dx * dx + dy * dy + dz * dz);
    const cube = inverse * inverse * inverse;
    for (let i = 0; i < 3; i++) {
      const c = coefficients[s + i];
      const slope = c * cube;
      sums[4 * i] += c * inverse;
      sums[4 * i + 1] -= slope * dx;
      sums[4 * i + 2] -= slope * dy;
      sums[4 * i + 3] -= slope * dz;
    }
  }
  const factor = 1 / (4 * Math.PI);
  for (let i = 0; i < 3; i++) {
    image[i] += factor * sums[4 * i];
    for (let k = 0; k < 3; k++) jacobian[i][k] += factor * sums[4 * i + 1 + k];
  }
  return { image, jacobian };
}

export function determinant([[a, b, c], [d, e, f], [g, h, i]]) {
  return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
}

/** `‖J‖²`. */
export function harmonicDensity(jacobian) {
  return jacobian.flat().reduce((sum, entry) => sum + entry * entry, 0);
}

/** `½ σ:ε` of the strain `JᵀJ − I`. */
export function deformationDensity(jacobian, { lambda, mu }) {
  const strain = [0, 1, 2].map((i) => [0, 1, 2].map((k) => dotColumns(jacobian, i, k) - (i === k ? 1 : 0)));
  const trace = strain[0][0] + strain[1][1] + strain[2][2];
  return (lambda * trace * trace + 2 * mu * harmonicDensity(strain)) / 2;
}

const dotColumns = (m, i, k) => m[0][i] * m[0][k] + m[1][i] * m[1][k] + m[2][i] * m[2][k];

/** The stretches, largest first, by Hestenes' rotations of pairs of columns until they are orthogonal. */
export function stretches(jacobian) {
  const m = jacobian.map((row) => [...row]);
  for (let sweep = 0; sweep < 30; sweep++) {
    let turned = false;
    for (const [i, k] of [[0, 1], [0, 2], [1, 2]]) {
      const [aa, bb, ab] = [dotColumns(m, i, i), dotColumns(m, k, k), dotColumns(m, i, k)];
      if (Math.abs(ab) <= 1e-15 * Math.sqrt(aa * bb) || ab === 0) continue;
      turned = true;
      const tau = (bb - aa) / (2 * ab);
      const tangent = (tau >= 0 ? 1 : -1) / (Math.abs(tau) + Math.sqrt(1 + tau * tau));
      const cosine = 1 / Math.sqrt(1 + tangent * tangent);
      const sine = cosine * tangent;
      for (const row of m) [row[i], row[k]] = [cosine * row[i] - sine * row[k], sine * row[i] + cosine * row[k]];
    }
    if (!turned) break;
  }
  return [0, 1, 2].map((k) => Math.sqrt(dotColumns(m, k, k))).sort((a, b) => b - a);
}
