// Elements of the page: controls with labels, tables. Text is always set as text, whatever it contains.

/** An element with attributes, and children that are elements or text. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== false) made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.filter((child) => child !== undefined));
  return made;
}

/** A group of controls with a title. */
export function group(title, ...controls) {
  return element('fieldset', {}, element('legend', {}, title), ...controls);
}

let made = 0;

function labelled(label, control, extra) {
  control.id = `control-${(made += 1)}`;
  return element('div', { class: 'control' }, element('label', { for: control.id }, label), control, extra);
}

/** A slider; `shown` says its value in words. */
export function slider(label, { min = 0, max = 1, step = 0.005, value, shown }, changed) {
  const input = element('input', { type: 'range', min, max, step, value });
  // The slider itself says it to who does not see it.
  const output = element('span', { class: 'value', 'aria-hidden': 'true' });
  const update = () => {
    output.textContent = shown(Number(input.value));
    input.setAttribute('aria-valuetext', output.textContent);
  };
  input.addEventListener('input', () => {
    update();
    changed(Number(input.value));
  });
  update();
  return { element: labelled(label, input, output), input, update };
}

/** A remark beneath a control. */
export function remark(text) {
  return element('p', { class: 'legend' }, text);
}

/** A choice among `[value, text]`. */
export function choice(label, options, value, changed) {
  const select = element('select', {}, ...options.map(([key, text]) => element('option', { value: key }, text)));
  select.value = value;
  select.addEventListener('change', () => changed(select.value));
  return { element: labelled(label, select), input: select };
}

/** A box to tick. */
export function tick(label, checked, changed) {
  const input = element('input', { type: 'checkbox', checked });
  input.id = `control-${(made += 1)}`;
  input.addEventListener('change', () => changed(input.checked));
  return { element: element('div', { class: 'control ticked' }, input, element('label', { for: input.id }, label)), input };
}

/** A button. */
export function button(text, pressed) {
  const input = element('button', { type: 'button' }, text);
  input.addEventListener('click', pressed);
  return input;
}

/** Three numbers, such as a point. */
export function triple(title, names, changed) {
  const inputs = names.map((name) => element('input', { type: 'number', step: 'any', 'aria-label': `${title} ${name}`, placeholder: name }));
  for (const input of inputs) {
    input.addEventListener('change', () => {
      if (inputs.every((one) => one.value !== '')) changed(inputs.map((one) => Number(one.value)));
    });
  }
  return element('div', { class: 'triple', role: 'group', 'aria-label': title }, ...inputs);
}

/** A list of names and values. */
export function list(entries) {
  return element('dl', {}, ...entries.flatMap(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]));
}

/** The tables of a report, the notes, and where everything comes from. */
export function about(data) {
  const parts = [];
  if (data.notes.length) {
    parts.push(element('ul', { class: 'notes' }, ...data.notes.map((note) => element('li', {}, note))));
  }
  for (const table of data.tables) parts.push(...numberTable(table));
  parts.push(element('h2', {}, 'Where this comes from'));
  const files = data.files.map(({ role, file, sha256 }) => element('tr', {},
    element('td', {}, role), element('td', {}, file), element('td', {}, element('code', {}, sha256))));
  parts.push(element('div', { class: 'scroll' }, element('table', {},
    element('thead', {}, heads('file', 'name', 'SHA-256')), element('tbody', {}, ...files))));
  parts.push(element('p', {}, 'Made by ', element('code', {}, data.program), ' with ', element('code', {}, data.command)));
  return element('section', { class: 'about' }, ...parts);
}

function heads(...names) {
  return element('tr', {}, ...names.map((name) => element('th', { scope: 'col' }, name)));
}

function numberTable({ title, rows }) {
  const lines = rows.map(({ name, value, unit, meaning }) => element('tr', {},
    element('th', { scope: 'row' }, name),
    element('td', { class: 'number' }, unit ? `${value} ${unit}` : value),
    element('td', {}, meaning)));
  return [
    element('h2', {}, title),
    element('div', { class: 'scroll' }, element('table', {},
      element('thead', {}, heads('number', 'value', 'meaning')), element('tbody', {}, ...lines))),
  ];
}

/**
 * A table of any columns. One without a head belongs to the one before. In each row the first `named` entries say what it is
 * about, and where there are fewer than columns the last fills the rest.
 */
export function dataTable({ columns, rows, named, meanings = [] }) {
  const kind = (column) => (column?.align === 'right' ? 'number' : undefined);
  const lines = rows.map((entries) => element('tr', {}, ...entries.map((entry, k) => {
    if (k < named) return element('th', { scope: 'row' }, entry);
    const left = columns.length - k;
    const fills = k + 1 === entries.length && left > 1;
    return element('td', fills ? { colspan: left } : { class: kind(columns[k]) }, entry);
  })));
  const isGrouped = columns.some(({ head }) => !head);
  // How many columns are below the head of each.
  const spans = columns.map((_, k) => {
    const end = columns.findIndex(({ head }, n) => n > k && head);
    return (end < 0 ? columns.length : end) - k;
  });
  const isAlone = ({ head, unit }, k) => head && !unit && spans[k] === 1;
  const first = columns.map((column, k) => {
    const { head, unit } = column;
    if (!head) return undefined;
    const shape = spans[k] > 1 ? { scope: 'colgroup', colspan: spans[k] } : { scope: 'col', class: kind(column) };
    const inBrackets = unit && !isGrouped ? element('span', { class: 'unit' }, ` (${unit})`) : undefined;
    return element('th', { ...shape, rowspan: isGrouped && isAlone(column, k) && 2, title: meanings[k] || undefined }, head, inBrackets);
  });
  const second = columns.map((column, k) => {
    if (isAlone(column, k)) return undefined;
    return column.unit ? element('th', { scope: 'col', class: kind(column) }, column.unit) : element('td');
  });
  const heads = isGrouped ? [first, second] : [first];
  return element('div', { class: 'scroll data' }, element('table', {},
    element('thead', {}, ...heads.map((entries) => element('tr', {}, ...entries))),
    element('tbody', {}, ...lines)));
}

/** A number as people read it: with a number of significant digits, and powers of ten where it is very large or small. */
export function significant(value, digits = 4) {
  if (!Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e6 || size < 1e-4)) return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}
