// Where the structure is drawn: renderer, camera, light, ground.

import {
  AmbientLight, BufferGeometry, CircleGeometry, Color, DirectionalLight, Float32BufferAttribute, Group, LineBasicMaterial,
  LineSegments, Mesh, MeshBasicMaterial, OrthographicCamera, PerspectiveCamera, Scene, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { FlatRenderer } from "./flat.js";
import { css } from "./palette.js";

export const FOOT = 0.058; // height of a foot under a held node, of a usual member's length

const ELEVATION = (16 * Math.PI) / 180;
const AZIMUTH = (-50 * Math.PI) / 180;
const FIELD_OF_VIEW = 32;
const SLOW = 42; // ms: frames that take longer are drawn with fewer pixels
const LEAST = 0.7; // pixels along a side, of those that the page has

export class Stage {
  constructor(canvas, model) {
    this.canvas = canvas;
    this.model = model;
    const card = graphics();
    this.software = card !== "card";
    this.flat = this.software && !(location.hash === "#webgl" && card); // that asks for WebGL where software plays it
    this.renderer = this.flat
      ? new FlatRenderer({ canvas })
      : new WebGLRenderer({ canvas, antialias: !this.software, powerPreference: "high-performance" });
    this.scene = new Scene();
    this.sun = new DirectionalLight(0xffffff, 2.2);
    this.scene.add(new AmbientLight(0xffffff, 1.6), this.sun);
    this.camera = model.planar ? new OrthographicCamera() : new PerspectiveCamera(FIELD_OF_VIEW);
    this.camera.up.set(0, 0, 1);
    if (model.planar && model.outOfPlane === 2) this.camera.up.set(0, 1, 0);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableRotate = !model.planar;
    this.controls.enableDamping = false;
    this.ground = new Group();
    this.scene.add(this.ground);
    this.sharpness = this.software && !this.flat ? 1 : Math.min(2, window.devicePixelRatio || 1);
    this.slow = 0;
    this.home();
    this.recolour();
  }

  // The middle of the structure at its start, and a radius around it that holds it.
  bounds() {
    const nodes = this.model.nodes;
    const low = [0, 1, 2].map((axis) => Math.min(...nodes.map((node) => node[axis])));
    const high = [0, 1, 2].map((axis) => Math.max(...nodes.map((node) => node[axis])));
    const centre = new Vector3(...low.map((value, axis) => 0.5 * (value + high[axis])));
    return { centre, radius: Math.max(...nodes.map((node) => centre.distanceTo(new Vector3(...node)))) || 1, low, high };
  }

  // Back to the view on the whole structure.
  home() {
    const { centre, radius } = this.bounds();
    this.radius = radius;
    const direction = this.model.planar
      ? new Vector3(...[[1, 0, 0], [0, -1, 0], [0, 0, 1]][this.model.outOfPlane])
      : new Vector3(Math.cos(ELEVATION) * Math.cos(AZIMUTH), Math.cos(ELEVATION) * Math.sin(AZIMUTH), Math.sin(ELEVATION));
    this.away = 10 * radius;
    this.camera.zoom = 1;
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(direction, this.away);
    this.resize(true);
    this.controls.update();
  }

  // Fit the canvas to its place on the page; anew: fit the view to the structure, too.
  resize(anew = false) {
    const width = Math.max(1, this.canvas.clientWidth);
    const height = Math.max(1, this.canvas.clientHeight);
    if (!anew && width === this.width && height === this.height && this.drawn === this.sharpness) return;
    [this.width, this.height, this.drawn] = [width, height, this.sharpness];
    this.renderer.setPixelRatio(this.sharpness);
    this.renderer.setSize(width, height, false);
    const aspect = width / height;
    const room = 1.22 * this.radius;
    if (this.camera.isOrthographicCamera) {
      const half = aspect > 1 ? [room * aspect, room] : [room, room / aspect];
      Object.assign(this.camera, { left: -half[0], right: half[0], top: half[1], bottom: -half[1], near: 0, far: 40 * this.radius });
    } else {
      this.camera.aspect = aspect;
      this.camera.near = 0.05 * this.radius;
      this.camera.far = 200 * this.radius;
      if (anew) {
        const half = (FIELD_OF_VIEW * Math.PI) / 360;
        const narrow = Math.min(half, Math.atan(Math.tan(half) * aspect));
        const direction = this.camera.position.clone().sub(this.controls.target).normalize();
        this.camera.position.copy(this.controls.target).addScaledVector(direction, (1.06 * this.radius + 2 * FOOT * this.model.member) / Math.sin(narrow));
      }
    }
    this.camera.updateProjectionMatrix();
  }

  // Take the theme's colours, and lay the ground anew.
  recolour() {
    this.scene.background = new Color(css("--stage"));
    this.ground.clear();
    const height = this.model.floor;
    if (height === null) return;
    const { centre, radius } = this.bounds();
    if (this.model.planar) {
      const below = height - FOOT * this.model.member;
      this.ground.add(lines([[-40, 0, 40, 0]].map((l) => l.map((v) => v * radius)), css("--mark"), centre, below, true));
      const hatches = Array.from({ length: 161 }, (_, i) => {
        const x = (i - 80) * 0.08 * radius;
        return [x, 0, x - 0.05 * radius, -0.05 * radius];
      });
      this.ground.add(lines(hatches, css("--mark"), centre, below, true));
      return;
    }
    const extent = 1.75 * radius;
    const disc = new Mesh(new CircleGeometry(extent, 64), new MeshBasicMaterial({ color: css("--ground"), polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 }));
    disc.position.set(centre.x, centre.y, height);
    const step = gridStep(radius);
    const rows = [];
    for (let at = -Math.floor(extent / step); at <= extent / step; at++) {
      const half = Math.sqrt(Math.max(0, extent * extent - at * at * step * step));
      rows.push([at * step, -half, at * step, half], [-half, at * step, half, at * step]);
    }
    this.ground.add(disc, lines(rows, css("--ground-line"), centre, height + 1e-4 * radius, false));
    this.gridStep = step;
  }

  // Draw; time: between the last frames, ms, which decides how many pixels there are; still: a picture that stays for a while,
  // with as many as there can be.
  draw(time, still = false) {
    const moving = this.sharpness;
    if (still) this.sharpness = 2;
    this.resize();
    this.sharpness = moving;
    this.sun.position.copy(this.camera.position).add(new Vector3(0, 0, 2 * this.radius));
    this.renderer.render(this.scene, this.camera);
    this.slow = time > SLOW ? this.slow + 1 : Math.max(0, this.slow - 1);
    if (this.slow > 20 && this.sharpness > LEAST) {
      this.sharpness = Math.max(LEAST, 0.85 * this.sharpness);
      this.slow = 0;
    }
  }

  // Where a point lies on the canvas: [x, y, depth], in its pixels.
  project(point) {
    const seen = point.clone().project(this.camera);
    return [0.5 * (1 + seen.x) * this.width, 0.5 * (1 - seen.y) * this.height, seen.z];
  }

  // The point below a place on the canvas that is as far from the eye as another point is.
  unproject(x, y, like) {
    const depth = like.clone().project(this.camera).z;
    return new Vector3((2 * x) / this.width - 1, 1 - (2 * y) / this.height, depth).unproject(this.camera);
  }
}

// What draws WebGL: "card", "software", or null: nothing does.
function graphics() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return null;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name) ? "software" : "card";
}

function gridStep(radius) {
  const power = 10 ** Math.floor(Math.log10(radius));
  return radius / power > 4 ? power : radius / power > 2 ? 0.5 * power : 0.2 * power;
}

// rows: [x, y, x, y] around the centre; upright: y is the height.
function lines(rows, colour, centre, height, upright) {
  const points = rows.flatMap(([x, y, u, v]) =>
    upright
      ? [centre.x + x, centre.y, height + y, centre.x + u, centre.y, height + v]
      : [centre.x + x, centre.y + y, height, centre.x + u, centre.y + v, height],
  );
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(points, 3));
  const made = new LineSegments(geometry, new LineBasicMaterial({ color: colour }));
  made.frustumCulled = false;
  return made;
}
