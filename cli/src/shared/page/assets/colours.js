// Colour scales: textures for shaders, and the legend.

import { DataTexture, LinearFilter, RGBAFormat, UnsignedByteType } from 'three';
import { element, significant } from 'page/elements';

/** A row of colours as a texture. */
export function paletteTexture(colours) {
  const texels = new Uint8Array(colours.flatMap((colour) => [...colour, 255]));
  const texture = new DataTexture(texels, colours.length, 1, RGBAFormat, UnsignedByteType);
  texture.minFilter = LinearFilter;
  texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** Shader code: the place of a value in the scale, from 0 to 1. */
export const SCALE_CODE = `
uniform sampler2D palette;
uniform vec2 ends;
uniform bool logarithmic;
vec3 scaleColour(float value) {
  if (isnan(value)) return vec3(0.55);
  vec2 range = logarithmic ? log(ends) : ends;
  float place = ((logarithmic ? log(max(value, 1e-30)) : value) - range.x) / (range.y - range.x);
  return texture2D(palette, vec2(clamp(place, 0.0, 1.0) * 0.996 + 0.002, 0.5)).rgb;
}`;

/** The value at a place of a field's scale. */
export function valueAt(field, place) {
  const { low, high, logarithmic } = field;
  return logarithmic ? low * (high / low) ** place : low + place * (high - low);
}

/** The legend of a scale, which `show(field)` fills; and, where there is such, of the colour of what is wrong. */
export function legend(palettes, wrongMeaning) {
  const canvas = element('canvas', { width: 256, height: 1, 'aria-hidden': 'true' });
  const ends = element('div', { class: 'ends' });
  const meaning = element('p');
  const swatch = element('span', { class: 'swatch', style: `background: rgb(${palettes.wrong.join(' ')})` });
  const wrong = wrongMeaning && element('p', {}, swatch, ` ${wrongMeaning}`);
  const show = (field) => {
    const colours = palettes[field.palette];
    const context = canvas.getContext('2d');
    const image = context.createImageData(colours.length, 1);
    colours.forEach((colour, k) => image.data.set([...colour, 255], 4 * k));
    context.putImageData(image, 0, 0);
    const shown = [0, 0.5, 1].map((place) => element('span', {}, significant(valueAt(field, place), 3)));
    ends.replaceChildren(...shown);
    const unit = field.unit && field.unit !== '×' ? ` (${field.unit})` : '';
    const clamps = field.clamps ? ' Values beyond the ends have the colours of the ends.' : '';
    const scale = field.logarithmic ? ' Logarithmic.' : '';
    meaning.textContent = `${field.meaning}${unit}.${scale}${clamps}`;
  };
  return { element: element('div', { class: 'legend' }, canvas, ends, meaning, ...(wrong ? [wrong] : [])), show };
}
