// Starts the page: what is written comes first, so that it is there also where nothing can be drawn.

import { readArrays } from 'page/data';
import { about } from 'page/elements';
import { showBoundary } from 'page/boundary';
import { showMap } from 'page/map';
import { showMesh } from 'page/mesh';
import { showReport } from 'page/report';
import { showSequence } from 'page/sequence';
import { showTexture } from 'page/texture';

const KINDS = { boundary: showBoundary, map: showMap, mesh: showMesh, report: showReport, sequence: showSequence, texture: showTexture };
/** What is shown without WebGL. */
const FLAT = ['report'];

/** Shows the page. */
export async function start(data, unpack, say) {
  const page = document.getElementById('page');
  page.append(about(data));
  if (!FLAT.includes(data.kind) && !document.createElement('canvas').getContext('webgl2')) {
    throw new Error('this browser has no WebGL 2, or it is switched off. The numbers are below.');
  }
  say('');
  const arrays = await readArrays(data.arrays, unpack);
  page.prepend(KINDS[data.kind](data, arrays));
}
