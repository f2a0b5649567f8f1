// A histogram of values with a range that is brushed, or set by two sliders.

import { element, significant, slider } from 'page/elements';

const BINS = 60;
const HEIGHT = 64;

/** The histogram of a field's values, from the least to the largest; `changed([from, to])` hears of the range. */
export function histogram(values, field, colours, changed) {
  let [least, most] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < least) least = value;
    if (value > most) most = value;
  }
  if (!(most > least)) [least, most] = [least - 0.5, least + 0.5];
  const counts = new Array(BINS).fill(0);
  for (const value of values) {
    if (Number.isFinite(value)) counts[Math.min(BINS - 1, Math.floor((BINS * (value - least)) / (most - least)))] += 1;
  }
  const tallest = Math.max(...counts, 1);
  const canvas = element('canvas', { class: 'histogram', width: BINS * 4, height: HEIGHT, 'aria-hidden': 'true' });
  const range = [least, most];
  const context = canvas.getContext('2d');
  const draw = () => {
    context.clearRect(0, 0, canvas.width, HEIGHT);
    counts.forEach((count, bin) => {
      const middle = least + ((bin + 0.5) / BINS) * (most - least);
      const place = Math.min(1, Math.max(0, (middle - field.low) / (field.high - field.low)));
      context.fillStyle = `rgb(${colours[Math.round(place * (colours.length - 1))].join(' ')})`;
      context.globalAlpha = middle >= range[0] && middle <= range[1] ? 1 : 0.22;
      // Few cells are the ones that matter: a root keeps them in sight beside many.
      const height = count ? Math.max(2, HEIGHT * Math.sqrt(count / tallest)) : 0;
      context.fillRect(4 * bin, HEIGHT - height, 3, height);
    });
  };
  const step = (most - least) / 1000;
  const ends = ['from', 'to'].map((label, end) => slider(label, {
    min: least, max: most, step, value: range[end], shown: (value) => significant(value, 3),
  }, (value) => {
    // Sliders round to their steps: at their ends they mean the ends.
    range[end] = end === 0 && value <= least + step ? least : end === 1 && value >= most - step ? most : value;
    draw();
    changed(range);
  }));
  const set = (from, to) => {
    [range[0], range[1]] = [from, to];
    ends.forEach(({ input, update }, end) => {
      input.value = range[end];
      update();
    });
    draw();
    changed(range);
  };
  const valueUnder = (event) => {
    const box = canvas.getBoundingClientRect();
    return least + Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) * (most - least);
  };
  let begun;
  canvas.addEventListener('pointerdown', (event) => {
    begun = valueUnder(event);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (begun === undefined) return;
    const now = valueUnder(event);
    set(Math.min(begun, now), Math.max(begun, now));
  });
  canvas.addEventListener('pointerup', (event) => {
    // A click without a range shows everything again.
    if (begun !== undefined && Math.abs(valueUnder(event) - begun) < (most - least) / BINS) set(least, most);
    begun = undefined;
  });
  draw();
  return { elements: [canvas, ...ends.map((end) => end.element)], range };
}
