// The controls of a plane across an axis, which cuts a solid in two.

import { choice, group, remark, significant, slider, tick } from 'page/elements';

const AXES = ['x', 'y', 'z'];

export class CutControls {
  /**
   * @param page has the `stage`, the `state` and the solid's `box` in model units, and `radius`, that of what is drawn as 1
   * @param changed called when the state has changed, with whether the plane has moved
   * @param more other controls of the group
   */
  constructor(page, radius, changed, ...more) {
    Object.assign(this, { page });
    const { state, stage, box } = page;
    const axes = choice('axis', AXES.map((name, k) => [k, `across ${name}`]), state.axis, (axis) => {
      state.axis = Number(axis);
      changed(true);
      position.update();
    });
    const position = slider('position', {
      value: state.position,
      shown: () => `${AXES[state.axis]} = ${significant(this.coordinate(), 4)}`,
    }, (value) => {
      state.position = value;
      changed(true);
      position.update();
    });
    stage.onShiftDrag(() => [0, 1, 2].map((k) => Number(k === state.axis)), (distance) => {
      const { axis } = state;
      position.input.value = state.position + (distance * radius) / (box[1][axis] - box[0][axis]);
      position.input.dispatchEvent(new Event('input'));
    });
    const cutting = tick('cut', state.cutting, (is) => {
      state.cutting = is;
      changed(false);
    });
    const half = tick('other half', false, () => {
      state.side = -state.side;
      changed(false);
    });
    this.element = group('Cut', axes.element, position.element, remark('Or drag the cut with Shift held.'),
      cutting.element, half.element, ...more);
  }

  /** The state to begin with: a cut through the middle, seen from the side of the camera. */
  static start(stage, [up]) {
    const axis = (up + 2) % 3;
    return { axis, position: 0.5, side: Math.sign(stage.camera.position.getComponent(axis)) || 1, cutting: true };
  }

  /** Where the plane is along its axis, in model units. */
  coordinate() {
    const { state: { axis, position }, box } = this.page;
    return box[0][axis] + position * (box[1][axis] - box[0][axis]);
  }
}

/** The box of a solid in model units. */
export function boxOf(placed, { centre, radius }) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (let n = 0; n < placed.length; n++) {
    const k = n % 3;
    low[k] = Math.min(low[k], placed[n]);
    high[k] = Math.max(high[k], placed[n]);
  }
  return [low, high].map((corner) => corner.map((x, k) => centre[k] + radius * x));
}
