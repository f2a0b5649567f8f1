// Colour scales: textures for shaders, and the legend.

import { DataTexture, LinearFilter, RGBAFormat, UnsignedByteType } from 'three';
import { element, significant } from 'page/elements';

/** A row of colours as a texture. */
function paletteTexture(colours) {
  const texels = new Uint8Array(colours.flatMap((colour) => [...colour, 255]));
  const texture = new DataTexture(texels, colours.length, 1, RGBAFormat, UnsignedByteType);
  texture.minFilter = LinearFilter;
  texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** The colours of one field at a time: the uniforms that `SCALE_CODE` reads. */
export class Scale {
  constructor(palettes) {
    this.palettes = Object.fromEntries(
      ['amount', 'ratio', 'quality', 'labels'].map((name) => [name, paletteTexture(palettes[name])]),
    );
    this.uniforms = {
      palette: { value: this.palettes.amount },
      ends: { value: [0, 1] },
      logarithmic: { value: false },
      labelColours: { value: 0 },
    };
  }

  /** Takes the colours of a field. */
  use(field) {
    const { palette, ends, logarithmic, labelColours } = this.uniforms;
    palette.value = this.palettes[field.palette];
    ends.value = [field.low, field.high];
    logarithmic.value = field.logarithmic;
    labelColours.value = field.palette === 'labels' ? palette.value.image.width : 0;
  }
}

/** Shader code: the colour of a value. Labels have one each, and after the last colour comes the first again. */
export const SCALE_CODE = `
uniform sampler2D palette;
uniform vec2 ends;
uniform bool logarithmic;
uniform float labelColours;
vec3 scaleColour(float value) {
  if (isnan(value)) return vec3(0.55);
  if (labelColours > 0.0) {
    return texture2D(palette, vec2((mod(floor(value + 0.5), labelColours) + 0.5) / labelColours, 0.5)).rgb;
  }
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
    const isLabels = field.palette === 'labels';
    const colours = isLabels ? labelsIn(field, palettes.labels) : palettes[field.palette];
    canvas.width = colours.length;
    const context = canvas.getContext('2d');
    const image = context.createImageData(colours.length, 1);
    colours.forEach((colour, k) => image.data.set([...colour, 255], 4 * k));
    context.putImageData(image, 0, 0);
    const shown = (isLabels ? [0, 1] : [0, 0.5, 1]).map((place) => element('span', {}, significant(valueAt(field, place), 3)));
    ends.replaceChildren(...shown);
    const unit = field.unit && field.unit !== '×' ? ` (${field.unit})` : '';
    const repeats = isLabels ? ` After ${palettes.labels.length} labels the colours repeat.` : '';
    const clamps = field.clamps ? ' Values beyond the ends have the colours of the ends.' : '';
    const scale = field.logarithmic ? ' Logarithmic.' : '';
    meaning.textContent = `${field.meaning}${unit}.${scale}${repeats}${clamps}`;
  };
  return { element: element('div', { class: 'legend' }, canvas, ends, meaning, ...(wrong ? [wrong] : [])), show };
}

/** The colours of the labels of a field in their order, or of as many as are told apart. */
function labelsIn({ low, high }, colours) {
  const [least, most] = [low, high].map(Math.round);
  const count = Math.min(most - least + 1, 4 * colours.length);
  const first = ((least % colours.length) + colours.length) % colours.length;
  return Array.from({ length: count }, (_, k) => colours[(first + k) % colours.length]);
}
