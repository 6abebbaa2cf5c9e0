"use strict";
// A robot in space: its bodies as a tree, turned by sliders or along a log.
const SCENES = new WeakMap();

class Arm {
  constructor(place, robot, motion) {
    this.place = place;
    this.robot = robot;
    this.q = robot.joints.map((joint) => joint.at);
    this.shown = { masses: [], solids: [] };
    this.motion = motion && Arm.unpackedMotion(motion);
    this.build();
    this.controls();
    this.pose();
  }

  static unpackedMotion(motion) {
    return { t: unpacked(motion.t), q: unpacked(motion.q) };
  }

  // Another log: the same arm, moved otherwise.
  move(motion) {
    this.motion = Arm.unpackedMotion(motion);
    this.rewind();
  }

  colour(name) { return new Three.Color(themed(name)); }

  build() {
    const box = this.place.getBoundingClientRect();
    this.renderer = new Three.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(box.width, box.height);
    this.place.append(this.renderer.domElement);
    this.scene = new Three.Scene();
    this.camera = new Three.PerspectiveCamera(35, box.width / box.height, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.scene.add(new Three.AmbientLight(0xffffff, 1.4));
    const sun = new Three.DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, -3, 5);
    this.scene.add(sun);
    this.root = new Three.Group();
    this.scene.add(this.root);
    this.groups = this.robot.bodies.map(() => new Three.Group());
    this.robot.bodies.forEach((body, k) => {
      const group = this.groups[k];
      group.matrixAutoUpdate = false;
      (body.parent < 0 ? this.root : this.groups[body.parent]).add(group);
      this.addMass(body, group);
    });
    this.robot.solids.forEach((solid) => this.addSolid(solid));
    (this.robot.lines || []).forEach((lines) => this.addLines(lines));
    this.look();
    this.orbit = new Three.OrbitControls(this.camera, this.renderer.domElement);
    this.orbit.target.copy(this.middle);
    this.orbit.addEventListener("change", () => this.draw());
    this.orbit.update();
  }

  static placed(thing, rotation, position) {
    const [a, b, c, d, e, f, g, h, i] = rotation, [x, y, z] = position;
    thing.matrixAutoUpdate = false;
    thing.matrix.set(a, b, c, x, d, e, f, y, g, h, i, z, 0, 0, 0, 1);
    return thing;
  }

  addSolid(solid) {
    const geometry = new Three.BufferGeometry();
    geometry.setAttribute("position", new Three.BufferAttribute(unpacked(solid.corners), 3));
    geometry.setIndex(solid.faces);
    const flat = geometry.toNonIndexed();
    flat.computeVertexNormals();
    const style = { color: this.colour(solid.colour || "--pale"), side: Three.DoubleSide, transparent: true, opacity: solid.opacity || 0.55 };
    const mesh = new Three.Mesh(flat, new Three.MeshStandardMaterial(style));
    mesh.userData.colour = solid.colour || "--pale";
    Arm.placed(mesh, solid.rotation, solid.position);
    (solid.body < 0 ? this.root : this.groups[solid.body]).add(mesh);
    this.shown.solids.push(mesh);
  }

  addMass(body, group) {
    if (!body.ellipsoid) return;
    const { half, axes } = body.ellipsoid;
    const style = { color: this.colour("--vermillion"), transparent: true, opacity: 0.75 };
    const mesh = new Three.Mesh(new Three.SphereGeometry(1, 24, 16), new Three.MeshStandardMaterial(style));
    mesh.userData.colour = "--vermillion";
    const scaled = axes.map((value, k) => value * Math.max(half[k % 3], 1e-4));
    group.add(Arm.placed(mesh, scaled, body.com));
    this.shown.masses.push(mesh);
  }

  // Lines [[from, to], ...] in the base frame, such as walls.
  addLines(lines) {
    const geometry = new Three.BufferGeometry();
    geometry.setAttribute("position", new Three.BufferAttribute(Float32Array.from(lines.points.flat(2)), 3));
    const material = new Three.LineBasicMaterial({ color: this.colour(lines.colour) });
    const segments = new Three.LineSegments(geometry, material);
    segments.userData.colour = lines.colour;
    this.root.add(segments);
  }

  // All of the arm in view in some postures: those of its motion, or with room to move.
  look() {
    const low = new Three.Vector3(), high = new Three.Vector3(), point = new Three.Vector3();
    const reach = this.robot.bodies.reduce((sum, body) => sum + Math.hypot(...body.position), 0.1);
    const frames = this.motion ? this.motion.q.length / this.motion.t.length : 0;
    const postures = this.motion ? [...Array(50).keys()].map((k) => {
      const row = Math.floor(k / 50 * this.motion.t.length) * frames;
      return [...this.motion.q.subarray(row, row + frames)];
    }) : [this.q];
    const own = this.q;
    postures.forEach((posture) => {
      this.q = own.map((value, k) => (Number.isFinite(posture[k]) ? posture[k] : value));
      this.turn();
      this.root.updateMatrixWorld(true);
      this.groups.forEach((group, k) => [0, 2].forEach((share) => {  // its frame and its far end
        point.fromArray((this.robot.bodies[k].com || [0, 0, 0]).map((value) => share * value));
        point.applyMatrix4(group.matrixWorld);
        low.min(point);
        high.max(point);
      }));
    });
    (this.robot.lines || []).forEach((lines) => lines.points.flat().forEach((end) => {
      point.fromArray(end); low.min(point); high.max(point);
    }));
    this.q = own;
    this.middle = low.clone().add(high).multiplyScalar(0.5);
    const radius = 0.5 * high.distanceTo(low) * (this.motion ? 1 : 1.35) + 0.12 * reach;
    const away = 0.8 * radius / Math.sin((17.5 * Math.PI) / 180);
    this.camera.position.copy(this.middle).add(new Three.Vector3(0.75, -0.85, 0.45).normalize().multiplyScalar(away));
    this.camera.near = away / 100;
    this.camera.far = 20 * away;
    this.camera.updateProjectionMatrix();
    const grid = new Three.GridHelper(2 * Math.ceil(reach), 4 * Math.ceil(reach), this.colour("--border"), this.colour("--line"));
    grid.rotation.x = Math.PI / 2;
    this.root.add(grid);
  }

  pose() {
    this.turn();
    this.draw();
  }

  // Place every body for the positions of the joints.
  turn() {
    this.robot.bodies.forEach((body, k) => {
      const x = body.kind === "floating" ? 0 : body.ratio * this.q[body.coordinate] + body.offset;
      const axis = new Three.Vector3(...body.axis), own = new Three.Matrix4();
      if (body.kind === "revolute") own.makeRotationAxis(axis, x);
      if (body.kind === "prismatic") own.makeTranslation(...axis.multiplyScalar(x).toArray());
      const group = this.groups[k];
      Arm.placed(group, body.rotation, body.position);
      group.matrix.multiply(own);
      group.matrixWorldNeedsUpdate = true;
    });
  }

  draw() { this.renderer.render(this.scene, this.camera); }

  controls() {
    const arm = this.place.closest(".arm");
    arm.querySelectorAll("[data-joint]").forEach((slider) => {
      const k = Number(slider.dataset.joint), joint = this.robot.joints[k], words = slider.nextElementSibling;
      const say = () => {
        const degrees = joint.unit === "rad" ? ` (${(this.q[k] * 180 / Math.PI).toFixed(0)}°)` : "";
        words.textContent = `${this.q[k].toFixed(2)} ${joint.unit}${degrees}`;
      };
      slider.addEventListener("input", () => { this.q[k] = Number(slider.value); say(); this.pose(); });
      say();
    });
    arm.querySelectorAll("[data-show]").forEach((box) => {
      box.addEventListener("change", () => {
        this.shown[box.dataset.show].forEach((mesh) => { mesh.visible = box.checked; });
        this.draw();
      });
    });
    this.place.addEventListener("keydown", (event) => this.key(event));
    if (this.motion) this.replay(arm);
    window.addEventListener("theme", () => {
      this.scene.traverse((one) => { if (one.userData.colour) one.material.color = this.colour(one.userData.colour); });
      this.draw();
    });
    new ResizeObserver(() => {
      const { clientWidth: width, clientHeight: height } = this.place;
      if (!width || !height) return;
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      this.renderer.setSize(width, height);
      this.draw();
    }).observe(this.place);
  }

  key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    const zoom = { "+": 0.9, "=": 0.9, "-": 1 / 0.9 }[event.key];
    if (!turns && !zoom) return;
    event.preventDefault();
    const away = this.camera.position.clone().sub(this.orbit.target);
    if (zoom) away.multiplyScalar(zoom);
    else {
      const round = Math.atan2(away.y, away.x) + 0.1 * turns[0], flat = Math.hypot(away.x, away.y);
      const rise = Math.min(Math.max(Math.atan2(away.z, flat) + 0.1 * turns[1], -1.5), 1.5), far = away.length();
      away.set(far * Math.cos(rise) * Math.cos(round), far * Math.cos(rise) * Math.sin(round), far * Math.sin(rise));
    }
    this.camera.position.copy(this.orbit.target).add(away);
    this.orbit.update();
    this.draw();
  }

  // Positions along the log, between two samples on a straight line; curves have a mark there.
  replay(arm) {
    const slider = arm.querySelector("[data-time]"), button = arm.querySelector("[data-play]"), now = arm.querySelector("[data-now]");
    let before = null;
    const show = () => {
      const { t, q } = this.motion, n = q.length / t.length;
      const at = Number(slider.value);
      let low = 0, high = t.length - 1;
      while (high - low > 1) { const mid = (low + high) >> 1; if (t[mid] <= at) low = mid; else high = mid; }
      const share = high > low && t[high] > t[low] ? (at - t[low]) / (t[high] - t[low]) : 0;
      for (let j = 0; j < n; j += 1) {
        const value = (1 - share) * q[low * n + j] + share * q[high * n + j];
        if (Number.isFinite(value)) this.q[j] = value;
      }
      now.textContent = `${at.toFixed(1)} s`;
      this.pose();
      markTime(at);
    };
    const step = (stamp) => {
      if (before === null || !this.place.isConnected) return;
      const next = Number(slider.value) + (stamp - before) / 1000;
      before = stamp;
      slider.value = next > Number(slider.max) ? slider.min : next;
      show();
      requestAnimationFrame(step);
    };
    const play = (on) => {
      button.textContent = on ? "Pause" : "Play";
      before = on ? performance.now() : null;
      if (on) requestAnimationFrame(step);
    };
    button.addEventListener("click", () => play(before === null));
    slider.addEventListener("input", () => { play(false); show(); });
    this.rewind = () => {
      const { t } = this.motion;
      play(false);
      slider.min = t[0];
      slider.max = t[t.length - 1];
      slider.value = t[0];
      show();
    };
    this.rewind();
  }
}

// A line at a time in every curve that is drawn over time.
function markTime(at) {
  document.querySelectorAll("[data-over-time] .picture").forEach((picture) => {
    const axis = picture._fullLayout && picture._fullLayout.xaxis;
    if (!axis) return;
    let mark = picture.querySelector(".cursor");
    if (!mark) {
      mark = document.createElement("div");
      mark.className = "cursor";
      picture.style.position = "relative";
      picture.append(mark);
    }
    const { _offset: top, _length: height } = picture._fullLayout.yaxis;
    Object.assign(mark.style, { top: `${top}px`, height: `${height}px` });
    const x = axis._offset + axis.l2p(at);
    mark.hidden = !(x >= axis._offset && x <= axis._offset + axis._length);
    mark.style.left = `${x}px`;
  });
}

const resultAt = async (address) => (address ? (await (await fetch(address)).json()).result : null);

// A scene is made once; then its arm only moves along another log.
function drawScene(place) {
  const { scene, motion } = place.dataset, before = SCENES.get(place);
  if (before && before.motion === motion) return;
  const ready = (before ? before.ready : Promise.resolve(null)).then(async (arm) => {
    const [robot, moved] = await Promise.all([arm ? null : resultAt(scene), resultAt(motion)]);
    if (arm) arm.move(moved.motion);
    const made = arm || new Arm(place, robot, moved && moved.motion);
    place.dataset.drawn = "yes";
    return made;
  }).catch((error) => {
    place.textContent = `The robot cannot be drawn: ${error.message}`;
    return null;
  });
  SCENES.set(place, { motion, ready });
}

window.addEventListener("content", () => document.querySelectorAll(".space3d").forEach(drawScene));
