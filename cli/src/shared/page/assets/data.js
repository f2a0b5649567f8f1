// The arrays of the page.

const TYPES = { Float32Array, Float64Array, Uint8Array, Uint32Array };

/** All arrays of the page by name, unpacked side by side. */
export async function readArrays(manifest, unpack) {
  const arrays = {};
  await Promise.all(manifest.map(async ({ name, entries, length }) => {
    arrays[name] = new TYPES[entries](await unpack(name), 0, length);
  }));
  return arrays;
}
