"use strict";
// The bodies of the 3-D view: base, legs of two parts, joints, platform, frames, paths, and the reference as a ghost.
(() => {
  const GS = GoughStewart;
  const STEEL = 0x8793a1, DARK = 0x4d5967, GHOST = 0x2e7d32;
  const AXES = [0xc0392b, 0x2e8b57, 0x2563a8];
  const UP = new THREE.Vector3(0, 0, 1);
  const vector = (a) => new THREE.Vector3(a[0], a[1], a[2]);

  // The size of things follows the platform, and the whole is scaled to a room of about three units about its base.
  const mean = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  const spread = (points, from) => Math.max(...points.map((p) => Math.hypot(p[0] - from[0], p[1] - from[1])));
  const MIDDLE = mean(GS.records.flatMap((r) => r.base));
  const extent = Math.max(...GS.records.flatMap((r) => [spread(r.base, MIDDLE), spread(r.platform, mean(r.platform))]));
  const reach = Math.max(...GS.records.map((r) => Math.hypot(...MIDDLE.map((m, k) => r.pose[k] - m))));
  const SIZE = Math.max(extent, 0.5 * reach);
  // How high, how low and how far aside the motion leads; one that flies away is not followed for ever.
  const heights = GS.records.flatMap((r) => r.base.map((p) => p[2]));
  const room = { low: Math.min(...heights), high: Math.max(...heights), aside: 0 };
  const near = (value, from) => Math.min(Math.max(value, from - 5 * SIZE), from + 5 * SIZE);
  for (const { time, pose } of GS.records) {
    for (let k = 0; k < 7 * time.length; k += 7) {
      const z = near(pose[k + 2], MIDDLE[2]);
      room.low = Math.min(room.low, z);
      room.high = Math.max(room.high, z);
      room.aside = Math.max(room.aside, near(Math.hypot(pose[k] - MIDDLE[0], pose[k + 1] - MIDDLE[1]), 0));
    }
  }
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

  // A plate under (side −1) or over (side 1) the joints, its edge a little outside of them.
  const plate = (points, thickness, side, colour, more) => {
    const [cx, cy, cz] = mean(points), bevel = 0.25 * thickness;
    const corners = outline(points).map(([x, y]) => {
      const away = 1 + 3.2 * unit / Math.max(Math.hypot(x - cx, y - cy), unit);
      return new THREE.Vector2(cx + (x - cx) * away, cy + (y - cy) * away);
    });
    const geometry = new THREE.ExtrudeGeometry(new THREE.Shape(corners), {
      depth: thickness, bevelEnabled: true, bevelSize: bevel, bevelThickness: bevel, bevelSegments: 3,
    });
    geometry.translate(0, 0, side < 0 ? cz - thickness : cz);
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
    // plates lie on the far sides of the joints, also where the platform hangs
    const below = record.pose[2] < MIDDLE[2] ? 1 : -1;
    const seen = new THREE.Vector3(...MIDDLE).sub(new THREE.Vector3(...record.pose.subarray(0, 3)));
    const above = seen.applyQuaternion(new THREE.Quaternion(...record.pose.subarray(3, 7)).invert()).z > 0 ? -1 : 1;
    group.add(plate(record.base, 2.2 * unit, below, index ? STEEL : 0xb9c2cc, index ? { transparent: true, opacity: 0.5 } : undefined));
    const platform = new THREE.Group();
    platform.add(plate(record.platform, 1.8 * unit, above, colour, { transparent: true, opacity: several ? 0.72 : 0.9 }));
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
        const next = base.filter((other) => other !== point).sort((a, b) => a.distanceTo(point) - b.distanceTo(point))[0];
        const out = point.clone().sub(vector(MIDDLE)).setZ(0).setLength(6.5 * unit);
        name.position.copy(point).add(out).add(point.clone().sub(next).setZ(0).setLength(4 * unit));
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
      const body = plate(record.platform, 1.8 * unit, above, GHOST, { transparent: true, opacity: 0.22, depthWrite: false });
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

  GS.bodies = { vector, frame, machine, unit, extent, SIZE, MIDDLE, room, UP };
})();
