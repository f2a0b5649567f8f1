// What is on the graphics card, and changes.

import { BufferAttribute, DataTexture, LinearFilter, RedFormat, UnsignedByteType } from 'three';

/** Sets attributes; their buffers on the graphics card are made anew where their sizes change. */
export function replace(geometry, attributes) {
  for (const [name, [values, size]] of Object.entries(attributes)) {
    const old = geometry.getAttribute(name);
    if (old && old.array.length === values.length) {
      old.array.set(values);
      old.needsUpdate = true;
    } else {
      geometry.setAttribute(name, new BufferAttribute(values, size));
    }
  }
}

/** Sets the corners, the triangles and the outline of a cut, and returns what of its plane belongs to the solid. */
export function replaceCut(cut, plane, outline) {
  replace(plane, { position: [cut.domain, 3], image: [cut.image, 3], uv: [cut.uv, 2] });
  plane.setIndex(new BufferAttribute(cut.indices, 1));
  replace(outline, { position: [cut.outline.from, 3], image: [cut.outline.to, 3] });
  const mask = new DataTexture(cut.mask, ...cut.maskSize, RedFormat, UnsignedByteType);
  mask.minFilter = LinearFilter;
  mask.magFilter = LinearFilter;
  mask.unpackAlignment = 1;
  mask.needsUpdate = true;
  return mask;
}
