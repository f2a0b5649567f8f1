// Views side by side with one camera: turned by the pointer or the keyboard, drawn when something has changed.

import { PerspectiveCamera, Scene, Vector2, Vector3, Raycaster, WebGLRenderer } from 'three';
import { OrbitControls } from 'three/orbit';
import { element } from 'page/elements';

/** Everything is scaled to a ball of radius 1 around the origin. */
const FIELD = 30;
const AZIMUTH = 35;
const ELEVATION = 22;
/** Degrees that a key turns by. */
const TURN = 7.5;
/** How much of a view is filled from where it begins. */
const MARGIN = 0.9;

export class Stage {
  /** One view for each caption. `up` is the axis that points up, and whether by its negative end. */
  constructor(captions, [axis, negative]) {
    this.element = element('div', { class: captions.length > 1 ? 'stage' : 'stage alone' });
    this.up = new Vector3().setComponent(axis, negative ? -1 : 1);
    this.camera = new PerspectiveCamera(FIELD, 1, 0.1, 100);
    this.camera.up.copy(this.up);
    this.views = captions.map((caption) => this.#view(caption));
    this.controls = new OrbitControls(this.camera, this.element);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.5;
    this.controls.maxDistance = 20;
    this.controls.addEventListener('start', () => { this.atHome = false; });
    this.controls.addEventListener('change', () => this.draw());
    this.shown = [];
    this.home();
    new ResizeObserver(() => this.#resize()).observe(this.element);
    this.beforeDraw = () => {};
  }

  #view(caption) {
    const canvas = element('canvas', {
      tabindex: 0,
      role: 'img',
      'aria-label': `${caption}: arrow keys turn it, + and − come nearer, 0 goes back`,
    });
    const text = element('figcaption', {}, caption);
    this.element.append(element('figure', { class: 'view' }, canvas, text));
    // The picture is kept, so that it can be saved after it was drawn.
    const renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    renderer.setClearAlpha(0);
    canvas.addEventListener('keydown', (event) => this.#key(event));
    return { canvas, text, renderer, scene: new Scene() };
  }

  /** Looks from where it began. */
  home() {
    const along = new Vector3().setComponent((this.up.toArray().findIndex((x) => x !== 0) + 1) % 3, 1);
    const [azimuth, elevation] = [AZIMUTH, ELEVATION].map((degrees) => (degrees * Math.PI) / 180);
    along.applyAxisAngle(this.up, azimuth);
    along.multiplyScalar(Math.cos(elevation)).addScaledVector(this.up, Math.sin(elevation));
    this.controls.target.set(0, 0, 0);
    this.camera.position.copy(along).multiplyScalar(this.#distance(along));
    this.atHome = true;
    this.controls.update();
    this.draw();
  }

  /** What must be in view from where it begins: arrays of coordinates. */
  show(...points) {
    this.shown = points;
    this.home();
  }

  /** From how far everything is in view, in a direction. */
  #distance(direction) {
    const slope = MARGIN * Math.tan((FIELD * Math.PI) / 360);
    const right = new Vector3().crossVectors(this.up, direction).normalize();
    const above = new Vector3().crossVectors(direction, right);
    let distance = 1;
    const point = new Vector3();
    for (const points of this.shown) {
      const stride = 3 * Math.ceil(points.length / 60_000);
      for (let k = 0; k < points.length; k += stride) {
        point.fromArray(points, k);
        const needed = Math.max(Math.abs(point.dot(above)), Math.abs(point.dot(right)) / this.camera.aspect) / slope;
        distance = Math.max(distance, point.dot(direction) + needed);
      }
    }
    return distance;
  }

  #key(event) {
    const turn = (TURN * Math.PI) / 180;
    const offset = this.camera.position.clone().sub(this.controls.target);
    const right = new Vector3().crossVectors(this.up, offset).normalize();
    const angle = offset.angleTo(this.up);
    const actions = {
      ArrowLeft: () => offset.applyAxisAngle(this.up, -turn),
      ArrowRight: () => offset.applyAxisAngle(this.up, turn),
      ArrowUp: () => offset.applyAxisAngle(right, -Math.min(turn, angle - 0.02)),
      ArrowDown: () => offset.applyAxisAngle(right, Math.min(turn, Math.PI - 0.02 - angle)),
      '+': () => offset.multiplyScalar(0.9),
      '=': () => offset.multiplyScalar(0.9),
      '-': () => offset.multiplyScalar(1 / 0.9),
      0: () => this.home(),
    };
    const action = actions[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
    if (event.key !== '0') {
      this.atHome = false;
      this.camera.position.copy(this.controls.target).add(offset);
      this.controls.update();
      this.draw();
    }
  }

  #resize() {
    for (const { canvas, renderer } of this.views) {
      const { clientWidth: width, clientHeight: height } = canvas;
      renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
      renderer.setSize(width, height, false);
      this.camera.aspect = width / Math.max(height, 1);
    }
    this.camera.updateProjectionMatrix();
    this.sized = true;
    if (this.atHome) this.home();
    this.draw(true);
  }

  /** Draws with the next frame of the screen, once for all that has changed; or at once. */
  draw(now = false) {
    // Nothing is seen before the first size is known.
    if (!this.sized) return;
    if (now) this.#render();
    else this.waiting ??= requestAnimationFrame(() => this.#render());
  }

  #render() {
    cancelAnimationFrame(this.waiting);
    this.waiting = undefined;
    this.beforeDraw();
    for (const { renderer, scene } of this.views) renderer.render(scene, this.camera);
  }

  /**
   * Calls with a view's number and the ray under the pointer, as its scene is turned, at most once a frame; with nothing when
   * the pointer leaves.
   */
  onPointer(heard) {
    this.views.forEach(({ canvas, scene }, number) => {
      let latest;
      canvas.addEventListener('pointermove', (event) => {
        if (event.buttons) return;
        if (!latest) {
          requestAnimationFrame(() => {
            const box = canvas.getBoundingClientRect();
            const x = (2 * (latest.clientX - box.left)) / box.width - 1;
            const y = 1 - (2 * (latest.clientY - box.top)) / box.height;
            const caster = new Raycaster();
            caster.setFromCamera(new Vector2(x, y), this.camera);
            latest = undefined;
            heard(number, caster.ray.applyMatrix4(scene.matrixWorld.clone().invert()));
          });
        }
        latest = event;
      });
      canvas.addEventListener('pointerleave', () => heard(number, undefined));
    });
  }

  /** Calls with how far the pointer is dragged along a direction of the solids, while Shift is held. */
  onShiftDrag(direction, heard) {
    this.views.forEach(({ canvas }, number) => {
      let last;
      canvas.addEventListener('pointerdown', (event) => {
        if (!event.shiftKey || event.button !== 0) return;
        // Otherwise the camera would move too.
        event.stopPropagation();
        canvas.setPointerCapture(event.pointerId);
        last = [event.clientX, event.clientY];
      });
      canvas.addEventListener('pointermove', (event) => {
        if (!last) return;
        const along = direction();
        const [from, to] = [[0, 0, 0], along].map((point) => this.project(number, point));
        const [x, y] = [to[0] - from[0], to[1] - from[1]];
        const moved = [event.clientX - last[0], event.clientY - last[1]];
        last = [event.clientX, event.clientY];
        // Seen from its end a direction has hardly a length on the screen, and no drag is along it.
        if (Math.hypot(x, y) > 5) heard((moved[0] * x + moved[1] * y) / (x * x + y * y));
      });
      for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, () => { last = undefined; });
    });
  }

  /** Where a point of a view is in its element, in pixels of the page. */
  project(number, point) {
    const { canvas, scene } = this.views[number];
    const box = canvas.getBoundingClientRect();
    const at = new Vector3(...point).applyMatrix4(scene.matrixWorld).project(this.camera);
    return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height];
  }

  /** All views in one picture, with captions, on the page's background. */
  picture() {
    this.draw(true);
    const styles = getComputedStyle(document.body);
    const canvases = this.views.map(({ canvas }) => canvas);
    const width = canvases.reduce((sum, canvas) => sum + canvas.width, 0);
    const whole = element('canvas', { width, height: canvases[0].height });
    const context = whole.getContext('2d');
    context.fillStyle = styles.backgroundColor;
    context.fillRect(0, 0, whole.width, whole.height);
    const size = Math.max(12, canvases[0].height / 32);
    context.font = `${size}px system-ui, sans-serif`;
    let left = 0;
    for (const { canvas, text } of this.views) {
      context.drawImage(canvas, left, 0);
      context.fillStyle = styles.color;
      context.fillText(text.textContent, left + size, 1.6 * size);
      left += canvas.width;
    }
    return whole;
  }

  /** Offers the picture as a file. */
  save(name) {
    this.picture().toBlob((blob) => {
      const link = element('a', { href: URL.createObjectURL(blob), download: name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    });
  }
}
