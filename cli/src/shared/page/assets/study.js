// The page of a study: a picture, a table of all rows, and what its columns mean.

import { element } from 'page/elements';

export function showStudy(data) {
  const picture = element('img', { class: 'chart', src: data.picture, alt: data.alternative });
  const heads = [
    ...data.varied.map((name) => element('th', { scope: 'col' }, name)),
    ...data.quantities.map(({ name, unit, meaning }) => element('th', { scope: 'col', class: 'number', title: meaning },
      name, unit ? element('span', { class: 'unit' }, ` (${unit})`) : undefined)),
  ];
  const rows = data.rows.map(({ varied, values, error }) => element('tr', {},
    ...varied.map((value) => element('th', { scope: 'row' }, value)),
    ...(error
      ? [element('td', { colspan: data.quantities.length }, error)]
      : values.map((value) => element('td', { class: 'number' }, value)))));
  const meanings = data.quantities.map(({ name, unit, meaning }) => element('tr', {},
    element('th', { scope: 'row' }, name), element('td', {}, unit), element('td', {}, meaning)));
  return element('section', { class: 'study' },
    picture,
    element('h2', {}, 'All rows'),
    element('div', { class: 'scroll' }, element('table', {},
      element('thead', {}, element('tr', {}, ...heads)), element('tbody', {}, ...rows))),
    element('h2', {}, 'What the columns mean'),
    element('div', { class: 'scroll' }, element('table', {},
      element('thead', {}, element('tr', {}, ...['column', 'unit', 'meaning'].map((name) => element('th', { scope: 'col' }, name)))),
      element('tbody', {}, ...meanings))));
}
