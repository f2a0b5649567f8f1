// The page of a report: a picture, words and tables.

import { dataTable, element } from 'page/elements';

const PARTS = {
  title: (title) => [element('h2', {}, title)],
  words: (words) => words.split('\n').map((line) => element('p', { class: 'words' }, line)),
  table: (table) => [dataTable(table)],
};

export function showReport({ picture, parts }) {
  return element('section', {},
    picture ? element('img', { class: 'chart', src: picture.address, alt: picture.alternative }) : undefined,
    ...parts.flatMap(({ kind, content }) => PARTS[kind](content)));
}
