// A curve over frames, with the current one marked; a click, a drag or the arrow keys go to another one.

import { element, significant } from 'page/elements';

const HEIGHT = 150;
const [LEFT, RIGHT, TOP, BOTTOM] = [58, 12, 10, 22];
/** More points than these are drawn without dots. */
const MOST_DOTS = 120;
const LEAPS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

export class Curve {
  /** Over `rows` with times; `shown` are the rows that can be gone to, and `go(n)` goes to the n-th of them. */
  constructor({ rows, shown, cycles, across }, go) {
    Object.assign(this, { rows, shown, cycles, across, go });
    this.current = 0;
    Object.assign(this, { values: [], label: '' });
    this.canvas = element('canvas', {
      class: 'curve', tabindex: 0, role: 'slider', 'aria-label': 'frame on the curve', 'aria-valuemin': 1, 'aria-valuemax': shown.length,
    });
    const times = rows.map(({ time }) => time);
    [this.first, this.last] = [Math.min(...times), Math.max(...times)];
    if (!(this.last > this.first)) [this.first, this.last] = [this.first - 0.5, this.last + 0.5];
    new ResizeObserver(() => this.#draw()).observe(this.canvas);
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.#draw());
    this.#listen();
  }

  /** Draws other values, one for each row; null where there is none. */
  show(values, label) {
    Object.assign(this, { values, label });
    this.#draw();
  }

  /** Marks the n-th frame that is shown; `said` is what it is, in words. */
  mark(n, said) {
    this.current = n;
    this.canvas.setAttribute('aria-valuenow', n + 1);
    this.canvas.setAttribute('aria-valuetext', said);
    this.#draw();
  }

  #listen() {
    const { canvas } = this;
    const follow = (event) => this.go(this.#nearest(event.clientX - canvas.getBoundingClientRect().left));
    canvas.addEventListener('pointerdown', (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      follow(event);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (canvas.hasPointerCapture(event.pointerId)) follow(event);
    });
    canvas.addEventListener('keydown', (event) => {
      const last = this.shown.length - 1;
      const to = { Home: 0, End: last }[event.key] ?? this.current + LEAPS[event.key];
      if (Number.isNaN(to) || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.go(Math.min(last, Math.max(0, to)));
    });
  }

  /** The frame that can be gone to whose time is nearest to a place across the curve. */
  #nearest(x) {
    const time = this.first + ((x - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT)) * (this.last - this.first);
    let best = 0;
    this.shown.forEach((row, n) => {
      if (Math.abs(this.rows[row].time - time) < Math.abs(this.rows[this.shown[best]].time - time)) best = n;
    });
    return best;
  }

  /** Where a frame that is shown is across the curve, in pixels of the canvas. */
  placeOf(n) {
    return this.#x(this.rows[this.shown[n]].time);
  }

  #x(time) {
    return LEFT + ((time - this.first) / (this.last - this.first)) * (this.canvas.clientWidth - LEFT - RIGHT);
  }

  #draw() {
    const { canvas, rows, values } = this;
    const width = canvas.clientWidth;
    if (!width) return;
    const scale = Math.min(window.devicePixelRatio, 2);
    [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(HEIGHT * scale)];
    const context = canvas.getContext('2d');
    context.scale(scale, scale);
    const colours = getComputedStyle(document.documentElement);
    const colour = (name) => colours.getPropertyValue(`--${name}`);
    const finite = values.filter(Number.isFinite);
    const least = Math.min(0, ...finite);
    const step = niceStep(Math.max(...finite, least) - least);
    const most = least + step * Math.max(1, Math.ceil((Math.max(...finite, least) - least) / step));
    const bottom = HEIGHT - BOTTOM;
    const y = (value) => bottom - ((value - least) / (most - least)) * (bottom - TOP);
    context.font = '12px system-ui, sans-serif';

    // Every other cycle has a ground of its own.
    context.fillStyle = colour('line');
    context.globalAlpha = 0.45;
    this.cycles.forEach((span, n) => {
      if (n % 2) return;
      const [from, to] = span.map((row) => Math.min(Math.max(this.#x(this.#timeOf(row)), LEFT), width - RIGHT));
      context.fillRect(from, TOP, to - from, bottom - TOP);
    });
    context.globalAlpha = 1;

    context.strokeStyle = colour('line');
    context.fillStyle = colour('quiet');
    context.textBaseline = 'middle';
    context.textAlign = 'right';
    for (let value = least; value <= most + step / 2; value += step) {
      context.beginPath();
      context.moveTo(LEFT, y(value));
      context.lineTo(width - RIGHT, y(value));
      context.stroke();
      context.fillText(significant(Number(value.toPrecision(6)), 3), LEFT - 6, y(value));
    }
    context.textBaseline = 'alphabetic';
    context.textAlign = 'left';
    context.fillText(this.label, LEFT + 6, TOP + 14);
    context.textAlign = 'center';
    const along = niceStep(this.last - this.first, 8);
    for (let time = Math.ceil(this.first / along) * along; time <= this.last + along / 1e6; time += along) {
      if (this.#x(time) < width - RIGHT - 60) context.fillText(significant(Number(time.toPrecision(6)), 4), this.#x(time), HEIGHT - 5);
    }
    context.textAlign = 'right';
    context.fillText(this.across, width - RIGHT, HEIGHT - 5);

    context.strokeStyle = colour('ink');
    context.lineWidth = 1.5;
    context.beginPath();
    let before = false;
    // What is not in the page has no values of its own in some curves: the line goes on to the next that has.
    values.forEach((value, row) => {
      if (!Number.isFinite(value)) {
        if (rows[row].skipped) before = false;
        return;
      }
      if (before) context.lineTo(this.#x(rows[row].time), y(value));
      else context.moveTo(this.#x(rows[row].time), y(value));
      before = true;
    });
    context.stroke();
    context.fillStyle = colour('ink');
    context.textAlign = 'center';
    rows.forEach(({ time, skipped }) => {
      if (skipped) context.fillText('×', this.#x(time), bottom - 3);
    });
    if (this.shown.length <= MOST_DOTS) {
      for (const row of this.shown) {
        if (Number.isFinite(values[row])) dot(context, this.#x(rows[row].time), y(values[row]), 2.2);
      }
    }

    const row = this.shown[this.current];
    const x = this.#x(rows[row].time);
    context.strokeStyle = colour('accent');
    context.fillStyle = colour('accent');
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, TOP);
    context.lineTo(x, bottom);
    context.stroke();
    if (Number.isFinite(values[row])) dot(context, x, y(values[row]), 5);
  }

  /** The time of a row that need not be whole, nor in range. */
  #timeOf(row) {
    const { rows } = this;
    const from = Math.min(Math.max(Math.floor(row), 0), Math.max(rows.length - 2, 0));
    const [a, b] = [rows[from], rows[from + 1] ?? rows[from]];
    return a.time + (row - from) * (b.time - a.time);
  }
}

function dot(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fill();
}

/** 1, 2 or 5 times a power of ten, so that there are a few steps in a range. */
function niceStep(range, count = 4) {
  if (!(range > 0) || !Number.isFinite(range)) return 1;
  const power = 10 ** Math.floor(Math.log10(range / count));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => range / step <= count * 1.000001);
}
