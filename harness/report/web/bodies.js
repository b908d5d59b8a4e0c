"use strict";
// The bodies of the 3-D view: base, legs of two parts, joints, platform, frames, paths, and the reference as a ghost.
GoughStewart.prepareBodies = () => {
  const GS = GoughStewart;
  const { vector, mean, material, tube, cone, merged, plate, curve, label, frame } = GS.shapes;
  const REFERENCE = 0x2e7d32, FORCE = 0xb3261e;
  const several = GS.records.length > 1;

  // Sizes follow the platform; the whole is scaled to a room of about three units around its base.
  const spread = (points, from) => Math.max(...points.map((p) => Math.hypot(p[0] - from[0], p[1] - from[1])));
  const MIDDLE = mean(GS.records.flatMap((r) => r.base));
  const extent = Math.max(...GS.records.flatMap((r) => [spread(r.base, MIDDLE), spread(r.platform, mean(r.platform))]));
  const reach = Math.max(...GS.records.map((r) => Math.hypot(...MIDDLE.map((m, k) => r.pose[k] - m))));
  const SIZE = Math.max(extent, 0.5 * reach), unit = 0.02 * SIZE;

  // Extent of the motion upward, downward and sideways, enlarged by a factor; at most five sizes.
  const near = (value, from) => Math.min(Math.max(value, from - 5 * SIZE), from + 5 * SIZE);
  const roomOf = (factor) => {
    const heights = GS.records.flatMap((r) => r.base.map((p) => p[2]));
    const room = { low: Math.min(...heights), high: Math.max(...heights), aside: 0 };
    for (const { time, pose, home } of GS.records) {
      for (let k = 0; k < 7 * time.length; k += 7) {
        const [x, y, z] = [0, 1, 2].map((i) => home[i] + factor * (pose[k + i] - home[i]));
        const height = near(z, MIDDLE[2]);
        room.low = Math.min(room.low, height);
        room.high = Math.max(room.high, height);
        room.aside = Math.max(room.aside, near(Math.hypot(x - MIDDLE[0], y - MIDDLE[1]), 0));
      }
    }
    return room;
  };

  // Material of base plates, and of joints and collars of all machines; the theme sets a visible shade.
  const joint = material(0), steel = material(0);
  const casts = (body) => Object.assign(body, { castShadow: true });
  // Six instances, each with its own transform; culling is off, since it would test only the first.
  const six = (geometry, paint) => Object.assign(new THREE.InstancedMesh(geometry, paint, 6), { frustumCulled: false });

  // The fixed parts: base plate, its joints, and the leg numbers. Runs of the same platform share them.
  const stand = (record) => {
    const group = new THREE.Group(), base = record.base.map(vector);
    // plates are on the far side of the joints, also if the platform hangs
    const below = record.pose[2] < MIDDLE[2] ? 1 : -1;
    const body = casts(new THREE.Mesh(plate(record.base, 2.2 * unit, below, 3.2 * unit), steel));
    body.receiveShadow = true;
    group.add(body);
    group.labels = base.map((point, k) => {
      const name = label(String(k + 1), "#000", 6 * unit);
      // placed outward, and away from the nearest other joint
      const next = base.filter((other) => other !== point).sort((a, b) => a.distanceTo(point) - b.distanceTo(point))[0];
      const out = point.clone().sub(vector(MIDDLE)).setZ(0).setLength(6.5 * unit);
      name.position.copy(point).add(out).add(point.clone().sub(next).setZ(0).setLength(4 * unit));
      return name;
    });
    group.add(...group.labels);
    return group;
  };

  // A leg: two telescoping parts, a cross of two pins with a hub below, a ball above; a core shows only where the leg is
  // longer than both parts together.
  const legs = (record) => {
    const pins = [0, Math.PI / 2].map((turn) => tube(0.6 * unit, 4.2 * unit, 8).translate(0, 0, -2.1 * unit).rotateX(Math.PI / 2).rotateZ(turn));
    const collar = tube(1.5 * unit, 1.6 * unit).translate(0, 0, record.lower - 1.6 * unit);
    const ball = (radius) => new THREE.SphereGeometry(radius, 14, 9);
    return {
      sleeve: casts(six(tube(1.25 * unit, record.lower), material(0xffffff))),
      lower: six(merged([...pins, collar, ball(1.45 * unit)]), joint),
      rod: casts(six(tube(0.75 * unit, record.upper), material(0xffffff))),
      upper: six(ball(1.5 * unit), joint),
      core: six(tube(0.3 * unit, 1, 8), joint),
    };
  };

  // The reference: an outline drawn last, and faces drawn first. Neither is depth-tested against the plate, so nothing
  // flickers where the two coincide.
  const ghostOf = (geometry, colour) => {
    const ghost = new THREE.Group(), depthless = { color: colour, depthTest: false, depthWrite: false };
    // custom blending, since objects marked transparent would be drawn last
    const faces = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      ...depthless, opacity: 0.22, blending: THREE.CustomBlending, blendSrcAlpha: THREE.OneFactor, side: THREE.FrontSide,
    }));
    faces.renderOrder = -1;
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 40), new THREE.LineBasicMaterial({ ...depthless, transparent: true, opacity: 0.75 }));
    edges.renderOrder = 8;
    ghost.add(faces, edges);
    return ghost;
  };

  // The external force: a shaft of unit length behind a head, with its tip at Op.
  const arrow = () => {
    const push = new THREE.Group(), paint = material(FORCE, { depthTest: false, transparent: true });
    push.add(new THREE.Mesh(tube(0.5 * unit, 1), paint), new THREE.Mesh(cone(1.5 * unit, 4 * unit), paint));
    for (const part of push.children) part.renderOrder = 9;
    push.visible = false;
    return push;
  };

  // One machine: its moving parts.
  const machine = (record, index) => {
    const colour = new THREE.Color(GS.page.palette.light.six[several ? record.run % 6 : 0]);
    const group = new THREE.Group(), platform = new THREE.Group();
    const seen = vector(MIDDLE).sub(vector(record.pose));
    const above = seen.applyQuaternion(new THREE.Quaternion(...record.pose.subarray(3, 7)).invert()).z > 0 ? -1 : 1;
    const geometry = plate(record.platform, 1.8 * unit, above, 3.2 * unit);
    // plates of several runs nearly coincide: they are blended in fixed order, since their depth order changes by frame
    const blended = several ? { transparent: true, opacity: 0.6, depthWrite: false } : {};
    // lighter than the path, which runs inside it
    const body = casts(new THREE.Mesh(geometry, material(colour.clone().lerp(new THREE.Color(0xffffff), 0.35), blended)));
    body.renderOrder = 1 + index;
    platform.add(body);
    const parts = legs(record), frames = frame(0.32 * SIZE, ["x", "y", "z"], unit);
    platform.add(frames);
    group.add(platform, ...Object.values(parts));
    const path = (values, paint, order, dash) => {
      const points = [];
      for (let k = 0; k < 7 * record.time.length; k += 7) points.push(new THREE.Vector3(values[k], values[k + 1], values[k + 2]));
      return curve(points, paint, order, dash);
    };
    const trails = [path(record.pose, colour, 6)];
    let ghost = null;
    if (record.reference) {
      // with several runs, the colour shows whose reference it is
      const paint = several ? colour : REFERENCE;
      ghost = ghostOf(geometry, paint);
      trails.push(path(record.reference, paint, 5, 0.6 * unit));
      group.add(ghost);
    }
    const push = arrow();
    group.add(...trails, push);
    const strongest = record.external_force ? record.external_force.reduce((most, f) => Math.max(most, Math.abs(f)), 0) : 0;
    return { record, group, platform, parts, ghost, trails, frames, push, strongest };
  };

  GS.bodies = { stand, machine, joint, steel, unit, extent, SIZE, MIDDLE, roomOf };
};
