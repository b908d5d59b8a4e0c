"use strict";
// The 3-D view: base, legs of two parts, joints, platform, frames, path, and the reference as a ghost.
(() => {
  const { THREE } = MeshCat;
  const GS = GoughStewart;
  const STEEL = 0x8793a1, DARK = 0x4d5967, GHOST = 0x2e7d32, PUSH = [0.84, 0.37, 0.0], PULL = [0.0, 0.45, 0.7], REST = [0.80, 0.83, 0.86];
  const AXES = [0xc0392b, 0x2e8b57, 0x2563a8];
  const UP = new THREE.Vector3(0, 0, 1);
  const vector = (a) => new THREE.Vector3(a[0], a[1], a[2]);

  // The size of things follows the platform, and the whole is scaled to a room of about three units.
  const extent = Math.max(...GS.records.flatMap((r) => [...r.base, ...r.platform].map((p) => Math.hypot(p[0], p[1]))));
  const height = Math.max(...GS.records.map((r) => Math.abs(r.pose[2] - r.base[0][2])));
  const SIZE = Math.max(extent, 0.5 * height);
  // How high and how far from the middle the motion leads; one that flies away is not followed for ever.
  const farthest = (of) => Math.min(GS.records.reduce((most, r) => {
    for (let k = 0; k < r.time.length; k++) most = Math.max(most, of(r.pose, 7 * k));
    return most;
  }, 0), 5 * SIZE);
  const top = farthest((pose, k) => pose[k + 2]), aside = farthest((pose, k) => Math.hypot(pose[k], pose[k + 1]));
  const unit = 0.02 * SIZE;

  const material = (colour, more = {}) => new THREE.MeshStandardMaterial({ color: colour, roughness: 0.55, metalness: 0.15, ...more });
  const mesh = (geometry, colour, more) => {
    const made = new THREE.Mesh(geometry, material(colour, more));
    made.castShadow = !(more && more.transparent);
    made.receiveShadow = true;
    return made;
  };

  // A tube from z = 0 to z = length.
  const tube = (radius, length, colour) => {
    const geometry = new THREE.CylinderGeometry(radius, radius, length, 28);
    geometry.rotateX(Math.PI / 2);
    geometry.translate(0, 0, length / 2);
    return mesh(geometry, colour);
  };

  // Convex outline of points seen along z, in order (Andrew's monotone chain).
  const outline = (points) => {
    const sorted = points.map((p) => [p[0], p[1]]).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const turn = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    const half = (list) => {
      const kept = [];
      for (const p of list) {
        while (kept.length > 1 && turn(kept[kept.length - 2], kept[kept.length - 1], p) <= 0) kept.pop();
        kept.push(p);
      }
      kept.pop();
      return kept;
    };
    return [...half(sorted), ...half([...sorted].reverse())];
  };

  // A plate under or over the joints, its edge a little outside of them.
  const plate = (points, thickness, colour, more) => {
    const middle = points.reduce((sum, p) => sum + p[2], 0) / points.length;
    const corners = outline(points).map(([x, y]) => {
      const away = 1 + 3.2 * unit / Math.max(Math.hypot(x, y), unit);
      return new THREE.Vector2(x * away, y * away);
    });
    const bevel = 0.25 * Math.abs(thickness);
    const geometry = new THREE.ExtrudeGeometry(new THREE.Shape(corners), {
      depth: Math.abs(thickness), bevelEnabled: true, bevelSize: bevel, bevelThickness: bevel, bevelSegments: 3,
    });
    geometry.translate(0, 0, middle + Math.min(thickness, 0));
    return mesh(geometry, colour, more);
  };

  const line = (points, colour, more = {}) => {
    const geometry = new THREE.BufferGeometry().setFromPoints(points);
    return new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour, ...more }));
  };

  const label = (text, colour, size) => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 64;
    const pen = canvas.getContext("2d");
    pen.font = "600 44px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillStyle = colour;
    pen.fillText(text, 32, 34);
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
    sprite.scale.setScalar(size);
    return sprite;
  };

  const frame = (length, names) => {
    const group = new THREE.Group();
    AXES.forEach((colour, k) => {
      const direction = new THREE.Vector3().setComponent(k, 1);
      const shaft = tube(0.22 * unit, length, colour);
      shaft.quaternion.setFromUnitVectors(UP, direction);
      const head = new THREE.ConeGeometry(0.7 * unit, 2 * unit, 16);
      head.rotateX(Math.PI / 2);
      const tip = mesh(head, colour);
      tip.quaternion.copy(shaft.quaternion);
      tip.position.copy(direction).multiplyScalar(length);
      // seen through what they stand in
      for (const part of [shaft, tip]) Object.assign(part.material, { depthTest: false, transparent: true, roughness: 1 });
      shaft.castShadow = tip.castShadow = false;
      const name = label(names[k], "#" + colour.toString(16).padStart(6, "0"), 5 * unit);
      name.position.copy(direction).multiplyScalar(length + 3.6 * unit);
      group.add(shaft, tip, name);
      for (const part of [shaft, tip, name]) part.renderOrder = 10;
    });
    return group;
  };

  // One machine: its bodies, and how to put them where a frame says.
  const machine = (record, index) => {
    const several = GS.records.length > 1;
    const colour = new THREE.Color(GS.page.colours[index]);
    const group = new THREE.Group();
    const base = record.base.map(vector), joints = record.platform.map(vector);
    group.add(plate(record.base, -2.2 * unit, index ? STEEL : 0xb9c2cc, index ? { transparent: true, opacity: 0.5 } : undefined));
    const platform = new THREE.Group();
    platform.add(plate(record.platform, 1.8 * unit, colour, { transparent: true, opacity: several ? 0.72 : 0.9 }));
    const legs = base.map((point, k) => {
      const lower = new THREE.Group(), upper = new THREE.Group();
      const sleeve = tube(1.25 * unit, record.lower, STEEL);
      const collar = tube(1.5 * unit, 1.6 * unit, DARK);
      collar.position.z = record.lower - 1.6 * unit;
      lower.add(sleeve, collar);
      lower.position.copy(point);
      upper.add(tube(0.75 * unit, record.upper, STEEL));
      // seen only where a leg is longer than its two parts together
      const core = tube(0.3 * unit, 1, DARK);
      group.add(core);
      // a cross of two pins below, a ball above
      for (const turn of [0, Math.PI / 2]) {
        const pin = tube(0.6 * unit, 4.2 * unit, DARK);
        pin.geometry.translate(0, 0, -2.1 * unit);
        pin.geometry.rotateX(Math.PI / 2);
        pin.geometry.rotateZ(turn);
        lower.add(pin);
      }
      const hub = mesh(new THREE.SphereGeometry(1.45 * unit, 24, 16), DARK);
      hub.position.copy(point);
      const ball = mesh(new THREE.SphereGeometry(1.5 * unit, 24, 16), DARK);
      ball.position.copy(joints[k]);
      platform.add(ball);
      group.add(hub, lower, upper);
      if (index === 0) {
        const name = label(String(k + 1), "#37424e", 6 * unit);
        // outward, and away from the nearest other joint
        const near = base.filter((other) => other !== point).sort((a, b) => a.distanceTo(point) - b.distanceTo(point))[0];
        const out = point.clone().setZ(0).setLength(6.5 * unit), aside = point.clone().sub(near).setZ(0).setLength(4 * unit);
        name.position.copy(point).add(out).add(aside);
        group.add(name);
      }
      return { lower, upper, core, sleeve, rod: upper.children[0] };
    });
    const frames = frame(0.32 * SIZE, ["x", "y", "z"]);
    platform.add(frames);
    group.add(platform);

    const path = (values, paint, more) => {
      const points = [];
      for (let k = 0; k < record.time.length; k++) points.push(new THREE.Vector3(values[7 * k], values[7 * k + 1], values[7 * k + 2]));
      return line(points, paint, more);
    };
    const trails = [path(record.pose, colour, { depthTest: false, transparent: true })];
    let ghost = null;
    if (record.reference) {
      ghost = new THREE.Group();
      const body = plate(record.platform, 1.8 * unit, GHOST, { transparent: true, opacity: 0.22, depthWrite: false });
      const edges = new THREE.LineSegments(new THREE.EdgesGeometry(body.geometry, 40), new THREE.LineBasicMaterial({ color: GHOST }));
      ghost.add(body, edges);
      group.add(ghost);
      trails.push(path(record.reference, GHOST, { depthTest: false, transparent: true, opacity: 0.6 }));
    }
    group.add(...trails);
    // the external force: a shaft of unit length behind a head, with its tip at Op
    const push = new THREE.Group(), shaft = tube(0.5 * unit, 1, 0xb3261e), tip = new THREE.ConeGeometry(1.5 * unit, 4 * unit, 20);
    tip.rotateX(Math.PI / 2);
    tip.translate(0, 0, -2 * unit);
    push.add(shaft, mesh(tip, 0xb3261e));
    push.traverse((part) => { if (part.material) Object.assign(part.material, { depthTest: false, transparent: true }); part.renderOrder = 9; });
    push.visible = false;
    group.add(push);
    const strongest = record.external_force ? record.external_force.reduce((most, f) => Math.max(most, Math.abs(f)), 0) : 0;
    return { record, group, platform, legs, ghost, trails, frames, push, strongest };
  };

  const quaternion = new THREE.Quaternion(), next = new THREE.Quaternion(), direction = new THREE.Vector3(), point = new THREE.Vector3();
  const place = (object, values, at) => {
    const from = 7 * at.frame;
    object.position.fromArray(GS.between(values, 7, at));
    quaternion.fromArray(values, from + 3);
    if (at.share > 0) quaternion.slerp(next.fromArray(values, from + 10), at.share);
    object.quaternion.copy(quaternion);
    object.updateMatrix();
  };

  const mix = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));
  const byForce = (force, largest) => {
    const share = Math.min(Math.abs(force) / largest, 1);
    return mix(REST, force < 0 ? PULL : PUSH, Math.sqrt(share));
  };
  // green to half of a limit, amber at 80 %, red from there on
  const byNearness = (near) => {
    const stops = [[0, [0.18, 0.55, 0.34]], [0.5, [0.45, 0.68, 0.28]], [0.8, [0.93, 0.68, 0.13]], [1, [0.78, 0.10, 0.10]]];
    if (near >= 1) return [0.55, 0.0, 0.25];
    const k = stops.findIndex((stop) => near <= stop[0]);
    if (k <= 0) return stops[0][1];
    const [[a, from], [b, to]] = [stops[k - 1], stops[k]];
    return mix(from, to, (near - a) / (b - a));
  };
  const LARGEST = GS.records.reduce((most, r) => r.force.reduce((m, f) => Math.max(m, Math.abs(f)), most), 1e-12);
  const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * x)).join(",")})`;
  GS.legColour = (kind, record, at, leg) => {
    if (kind === "force") return byForce(record.force[6 * at.frame + leg], LARGEST);
    if (kind === "nearness" && record.nearness) return byNearness(record.nearness.values[6 * at.frame + leg]);
    return [0.62, 0.67, 0.72];
  };
  GS.css = css;
  GS.legend = (kind) => {
    const bar = (colours) => `<i style="background:linear-gradient(90deg,${colours.map(css).join(",")})"></i>`;
    if (kind === "force") {
      const steps = [-1, -0.5, -0.25, 0, 0.25, 0.5, 1].map((s) => byForce(s * LARGEST, LARGEST));
      return `actuator force${bar(steps)}pulls ${GS.text(-LARGEST)} N <span>pushes ${GS.text(LARGEST)} N</span>`;
    }
    const limits = [...new Set(GS.records.flatMap((r) => (r.nearness ? r.nearness.of : [])))].join(", ");
    if (kind === "nearness" && limits) {
      return `nearest of ${limits}${bar([0, 0.25, 0.5, 0.65, 0.8, 0.9, 1].map((s) => byNearness(0.999 * s)))}middle <span>limit</span>`;
    }
    return "";
  };

  GS.scene = (element) => {
    const viewer = new MeshCat.Viewer(element, false);
    viewer.set_property(["Background"], "top_color", [0.93, 0.95, 0.97]);
    viewer.set_property(["Background"], "bottom_color", [1, 1, 1]);
    for (const path of ["Grid", "Axes", "Lights"]) viewer.set_property([path], "visible", false);
    viewer.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));

    const scale = 1.1 / SIZE, root = new THREE.Group();
    root.scale.setScalar(scale);
    const machines = GS.records.map(machine);
    root.add(...machines.map((m) => m.group));
    const ground = Math.min(...GS.records.flatMap((r) => r.base.map((p) => p[2]))) - 2.8 * unit;
    const floor = new THREE.Mesh(new THREE.CircleGeometry(3.2 * SIZE, 64), new THREE.ShadowMaterial({ opacity: 0.16 }));
    floor.position.z = ground;
    floor.receiveShadow = true;
    const cell = 10 ** Math.round(Math.log10(SIZE / 4)), cells = 2 * Math.ceil(2.2 * SIZE / cell / 2);
    const grid = new THREE.GridHelper(cells * cell, cells, 0xc3cbd4, 0xdde3e9);
    grid.rotateX(Math.PI / 2);
    grid.position.z = ground;
    const world = frame(0.42 * SIZE, ["X", "Y", "Z"]);
    root.add(floor, grid, world);
    const sun = new THREE.DirectionalLight(0xffffff, 0.75), sky = new THREE.HemisphereLight(0xffffff, 0xc8ccd2, 0.62);
    sun.position.set(2.2 * SIZE, -1.6 * SIZE, 5 * SIZE);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    sun.shadow.radius = 3;
    // in the units of the room
    Object.assign(sun.shadow.camera, { left: -2.6, right: 2.6, top: 2.6, bottom: -2.6, near: 0.1, far: 14 });
    root.add(sun, sun.target, sky);
    viewer.set_object(["gough-stewart"], root);

    // The camera lives in a frame whose y is up: (x, z, −y) of the room.
    const middle = scale * (ground + 0.5 * (top - ground));
    const radius = scale * Math.hypot(Math.max(extent, 0.6 * extent + aside), 0.6 * (top - ground));
    const places = { corner: [0.62, 0.36, 0.70], front: [0, 0.12, 1], side: [1, 0.12, 0], top: [0, 1, 0.001] };
    const look = (from) => {
      const [x, y, z] = places[from], size = Math.hypot(x, y, z);
      const narrow = Math.min(element.clientWidth / element.clientHeight, 1) || 1;
      const away = 0.97 * radius / Math.sin(viewer.camera.fov * Math.PI / 360) / narrow;
      viewer.controls.target.set(0, middle, 0);
      viewer.camera.position.set(away * x / size, middle + away * y / size, away * z / size);
      viewer.controls.update();
      viewer.set_dirty();
    };
    viewer.camera.fov = 36;
    viewer.camera.near = 0.02;

    let shown = "force";
    const show = (time) => {
      for (const m of machines) {
        const at = GS.frameAt(m.record, time);
        place(m.platform, m.record.pose, at);
        if (m.ghost) place(m.ghost, m.record.reference, at);
        m.legs.forEach((leg, k) => {
          point.fromArray(m.record.platform[k]).applyMatrix4(m.platform.matrix);
          direction.copy(point).sub(leg.lower.position);
          leg.core.scale.z = direction.length();
          direction.normalize();
          leg.lower.quaternion.setFromUnitVectors(UP, direction);
          leg.core.position.copy(leg.lower.position);
          leg.core.quaternion.copy(leg.lower.quaternion);
          leg.upper.position.copy(point);
          leg.upper.quaternion.setFromUnitVectors(UP, direction.negate());
          const colour = GS.legColour(shown, m.record, at, k);
          leg.rod.material.color.setRGB(...colour);
          leg.sleeve.material.color.setRGB(...mix(colour, [0.35, 0.38, 0.42], 0.25));
        });
        if (m.strongest) {
          const force = vector(m.record.external_force.subarray(3 * at.frame, 3 * at.frame + 3)), size = force.length();
          m.push.visible = size > 0;
          if (size > 0) {
            const length = (0.2 + 0.6 * size / m.strongest) * SIZE, [shaft] = m.push.children;
            m.push.quaternion.setFromUnitVectors(UP, force.divideScalar(size));
            m.push.position.copy(m.platform.position);
            shaft.scale.z = length;
            shaft.position.z = -length - 2 * unit;
          }
        }
      }
      viewer.set_dirty();
    };
    const resize = () => viewer.set_3d_pane_size(element.clientWidth, element.clientHeight);
    // the viewer would measure the window instead of its pane
    window.onload = null;
    viewer.set_3d_pane_size = ((own) => (w, h) => own.call(viewer, w || element.clientWidth, h || element.clientHeight))(viewer.set_3d_pane_size);
    new ResizeObserver(resize).observe(element);
    resize();
    look("corner");
    return {
      show, look,
      colourBy: (kind) => { shown = kind; },
      showGhosts: (on) => machines.forEach((m) => { if (m.ghost) m.ghost.visible = on; if (m.trails[1]) m.trails[1].visible = on && m.trails[0].visible; }),
      showTrails: (on) => machines.forEach((m) => m.trails.forEach((trail, k) => { trail.visible = on && (k === 0 || m.ghost.visible); })),
      showFrames: (on) => { world.visible = on; machines.forEach((m) => { m.frames.visible = on; }); },
      showMachine: (k, on) => { machines[k].group.visible = on; viewer.set_dirty(); },
      render: () => { if (viewer.needs_render) viewer.render(); },
      // What is drawn, in metres: for tests, and for scripts that drive the page.
      drawn: () => machines.map((m) => {
        root.updateMatrixWorld(true);
        const inRoom = new THREE.Matrix4().copy(root.matrixWorld).invert();
        const of = (object) => new THREE.Matrix4().multiplyMatrices(inRoom, object.matrixWorld);
        const matrix = of(m.platform).elements;
        const tip = (object, z) => new THREE.Vector3(0, 0, z).applyMatrix4(of(object)).toArray();
        return {
          position: matrix.slice(12, 15),
          rotation: [0, 1, 2].map((i) => [0, 1, 2].map((j) => matrix[i + 4 * j])),
          reference: m.ghost ? of(m.ghost).elements.slice(12, 15) : null,
          legs: m.legs.map((leg) => ({
            foot: tip(leg.lower, 0), sleeveEnd: tip(leg.lower, m.record.lower),
            head: tip(leg.upper, 0), rodEnd: tip(leg.upper, m.record.upper),
            colour: leg.rod.material.color.toArray(),
          })),
        };
      }),
    };
  };
})();
