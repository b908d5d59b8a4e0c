"use strict";
// The 3-D view: machines in a room, posed for the present time.
GoughStewart.prepareScene = () => {
  const GS = GoughStewart;
  const { stand, machine, joint, steel, unit, extent, SIZE, MIDDLE, roomOf } = GS.bodies;
  const { UP, vector, frame } = GS.shapes;
  // from the sun to the middle of the base, in sizes
  const SUN = [-2.2, 1.6, -5];
  const direction = new THREE.Vector3(), point = new THREE.Vector3(), foot = new THREE.Vector3();
  const turned = new THREE.Quaternion(), along = new THREE.Matrix4(), ONE = new THREE.Vector3(1, 1, 1), stretched = new THREE.Vector3();
  const paint = new THREE.Color(), GREY = [0.35, 0.38, 0.42];

  GS.scene = (element) => {
    const viewer = GS.viewer(element);
    const scale = 1.1 / SIZE, root = new THREE.Group();
    root.scale.setScalar(scale);
    root.position.copy(vector(MIDDLE)).multiplyScalar(-scale);
    const machines = GS.records.map(machine);
    const firsts = GS.records.filter((r, k) => GS.records.findIndex((other) => String(other.base) === String(r.base)) === k);
    const stands = firsts.map(stand);
    root.add(...stands, ...machines.map((m) => m.group));

    // leave space below a hanging platform
    const room = roomOf(1), hangs = GS.records.some((r) => r.pose[2] < MIDDLE[2]);
    const ground = room.low - (hangs ? 0.4 * SIZE : 2.8 * unit);
    // no larger than the shadows reach: each of its pixels costs a lookup in the shadow map
    const shade = Math.min(extent + room.aside + 0.6 * (room.high - ground), 3 * SIZE);
    const floor = new THREE.Mesh(new THREE.CircleGeometry(shade, 40), new THREE.ShadowMaterial());
    floor.position.set(MIDDLE[0], MIDDLE[1], ground);
    floor.receiveShadow = true;
    const world = frame(0.42 * SIZE, ["X", "Y", "Z"], unit);
    root.add(floor, world);
    const sun = new THREE.DirectionalLight(0xffffff, 0.7), sky = new THREE.HemisphereLight(0xffffff, 0xc8ccd2, 0.55);
    sun.position.copy(vector(MIDDLE)).addScaledVector(vector(SUN), -SIZE);
    sun.target.position.copy(vector(MIDDLE));
    sun.castShadow = true;
    sun.shadow.mapSize.setScalar(viewer.soft ? 768 : 1024);
    // in the units of the root's parent
    const wide = scale * shade;
    Object.assign(sun.shadow.camera, { left: -wide, right: wide, top: wide, bottom: -wide, near: 0.1, far: 14 });
    root.add(sun, sun.target, sky);
    viewer.room.add(root);

    const cell = 10 ** Math.round(Math.log10(SIZE / 4)), cells = 2 * Math.ceil(2.2 * SIZE / cell / 2);
    let grid = null;
    const dress = ({ dark }) => {
      if (grid) { root.remove(grid); grid.geometry.dispose(); }
      grid = new THREE.GridHelper(cells * cell, cells, ...(dark ? [0x52606e, 0x303b47] : [0xc3cbd4, 0xdde3e9]));
      grid.rotateX(Math.PI / 2);
      grid.position.copy(floor.position);
      root.add(grid);
      floor.material.opacity = dark ? 0.5 : 0.18;
      joint.color.set(dark ? 0x7d8b9a : 0x4d5967);
      steel.color.set(dark ? 0x76828f : 0xb9c2cc);
      for (const each of [world, ...machines.map((m) => m.frames)]) each.paint(dark);
      for (const label of stands.flatMap((each) => each.labels)) label.paint(dark ? "#d5dde5" : "#37424e");
      viewer.moved();
    };
    dress(GS.theme());
    GS.onTheme(dress);

    // The camera's frame has y up: (x, z, −y) of the room.
    let factor = 1;
    const places = { corner: [0.62, 0.36, 0.70], front: [0, 0.12, 1], side: [1, 0.12, 0], top: [0, 1, 0.001] };
    const away = new THREE.Vector3(), { camera, controls } = viewer;
    controls.lowest = scale * (ground + unit - MIDDLE[2]);
    // far enough in this direction to see the whole motion
    const fit = () => {
      const { high, aside } = roomOf(factor), middle = scale * (0.5 * (ground + high) - MIDDLE[2]);
      const radius = scale * Math.hypot(Math.max(extent, 0.6 * extent + aside), 0.6 * (high - ground));
      viewer.fit(new THREE.Vector3(0, middle, 0), away, 0.97 * radius);
    };
    let place = "corner";
    const look = (from) => {
      place = from;
      away.fromArray(places[from]);
      fit();
    };
    controls.home = () => look(place);

    let shown = "force";
    const set = (mesh, k, at, quaternion, size = ONE) => {
      mesh.setMatrixAt(k, along.compose(at, quaternion, size));
      mesh.instanceMatrix.needsUpdate = true;
    };
    const tint = (mesh, k, rgb) => {
      mesh.setColorAt(k, paint.setRGB(...rgb));
      mesh.instanceColor.needsUpdate = true;
    };
    const showLegs = ({ record, platform, parts }, index, at) => {
      let apart = false;
      for (let k = 0; k < 6; k++) {
        point.fromArray(record.platform[k]).applyMatrix4(platform.matrix);
        foot.fromArray(record.base[k]);
        direction.copy(point).sub(foot);
        const length = direction.length();
        turned.setFromUnitVectors(UP, direction.normalize());
        set(parts.sleeve, k, foot, turned);
        set(parts.lower, k, foot, turned);
        set(parts.core, k, foot, turned, stretched.set(1, 1, length));
        turned.setFromUnitVectors(UP, direction.negate());
        set(parts.rod, k, point, turned);
        set(parts.upper, k, point, turned);
        apart ||= length > record.lower + record.upper;
        const colour = GS.legColour(shown, record, at, k, index);
        tint(parts.rod, k, colour);
        tint(parts.sleeve, k, GS.mix(colour, GREY, 0.25));
      }
      parts.core.visible = apart;
    };
    const showForce = ({ record, platform, push, strongest }, at) => {
      if (!strongest) return;
      const force = vector(record.external_force.subarray(3 * at.frame, 3 * at.frame + 3)), size = force.length();
      push.visible = size > 0;
      if (!push.visible) return;
      const length = (0.2 + 0.6 * size / strongest) * SIZE, [shaft] = push.children;
      push.quaternion.setFromUnitVectors(UP, force.divideScalar(size));
      push.position.copy(platform.position);
      shaft.scale.z = length;
      shaft.position.z = -length - 2 * unit;
    };
    const show = (time) => {
      machines.forEach((m, index) => {
        const at = GS.frameAt(m.record, time);
        GS.place(m.platform, m.record.pose, m.record, at, factor);
        if (m.ghost) GS.place(m.ghost, m.record.reference, m.record, at, factor);
        showLegs(m, index, at);
        showForce(m, at);
      });
      viewer.moved();
    };
    const showTrails = (path, reference) => machines.forEach(({ trails }) => trails.forEach((trail, k) => {
      trail.visible = path && (k === 0 || reference);
    }));
    look("corner");
    return {
      show, look,
      canvas: viewer.canvas,
      copy: viewer.copy,
      render: viewer.render,
      colourBy: (kind) => { shown = kind; },
      enlarge: (times) => {
        factor = times;
        // p₀ + f (p − p₀) for all points of a path
        machines.forEach(({ trails, record }) => trails.forEach((trail) => {
          trail.scale.setScalar(factor);
          trail.position.copy(vector(record.home)).multiplyScalar(1 - factor);
        }));
        away.copy(camera.position).sub(controls.target);
        fit();
      },
      showParts: ({ reference, path, frames }) => {
        world.visible = frames;
        for (const m of machines) {
          m.frames.visible = frames;
          if (m.ghost) m.ghost.visible = reference;
        }
        showTrails(path, reference);
        viewer.changed();
      },
      showMachine: (k, on) => { machines[k].group.visible = on; viewer.moved(); },
      // the leg nearest to a pixel, 1 to 6; null if none is near
      legAt: (x, y) => {
        let best = { away: 12, leg: null };
        const stage = GS.stage(root, viewer, floor, SUN);
        GS.drawn(root, machines).forEach(({ legs }, k) => legs.forEach(({ foot: from, head }, leg) => {
          if (!machines[k].group.visible) return;
          const [a, b] = [from, head].map(stage.seen), [dx, dy] = [b[0] - a[0], b[1] - a[1]];
          const share = Math.min(Math.max(((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy || 1), 0), 1);
          const away = Math.hypot(a[0] + share * dx - x, a[1] + share * dy - y);
          if (away < best.away) best = { away, leg: leg + 1 };
        }));
        return best.leg;
      },
      // reduce resolution first, then shadows
      simpler: () => {
        if (!viewer.coarser()) sun.castShadow = floor.visible = false;
        viewer.changed();
      },
      drawn: () => GS.drawn(root, machines),
      stage: () => GS.stage(root, viewer, floor, SUN),
    };
  };
};

// The drawn objects in metres and room axes, for tests and for scripts that control the page.
(() => {
  const GS = GoughStewart;
  const matrix = new THREE.Matrix4();

  // Poses, paths and legs of all machines, as in the scene.
  GS.drawn = (root, machines) => {
    root.updateMatrixWorld(true);
    const inRoom = new THREE.Matrix4().copy(root.matrixWorld).invert();
    const of = (object) => new THREE.Matrix4().multiplyMatrices(inRoom, object.matrixWorld);
    const rotation = ({ elements }) => [0, 1, 2].map((i) => [0, 1, 2].map((j) => elements[i + 4 * j]));
    const path = (trail) => {
      const { position } = trail.children[0].geometry.attributes, at = of(trail.children[0]);
      return Array.from({ length: position.count }, (_, k) => new THREE.Vector3().fromBufferAttribute(position, k).applyMatrix4(at).toArray());
    };
    return machines.map(({ record, platform, ghost, trails, parts }) => {
      const tip = (mesh, k, z) => {
        mesh.getMatrixAt(k, matrix);
        return new THREE.Vector3(0, 0, z).applyMatrix4(matrix).toArray();
      };
      const pose = of(platform), reference = ghost && of(ghost), colour = new THREE.Color();
      return {
        position: pose.elements.slice(12, 15),
        rotation: rotation(pose),
        colour: platform.children[0].material.color.toArray(),
        reference: reference && reference.elements.slice(12, 15),
        referenceRotation: reference && rotation(reference),
        path: path(trails[0]),
        referencePath: trails[1] ? path(trails[1]) : null,
        pathColour: trails[0].children[0].material.color.toArray(),
        legs: record.base.map((_, k) => {
          parts.rod.getColorAt(k, colour);
          return {
            foot: tip(parts.sleeve, k, 0), sleeveEnd: tip(parts.sleeve, k, record.lower),
            head: tip(parts.rod, k, 0), rodEnd: tip(parts.rod, k, record.upper),
            colour: colour.toArray(),
          };
        }),
      };
    });
  };

  // Floor, sun, camera, whether the view is drawn sharp and at rest, and the position on the canvas of a point of the room [CSS pixels].
  GS.stage = (root, { camera, controls, canvas, isStill }, floor, sun) => {
    root.updateMatrixWorld(true);
    camera.updateMatrixWorld(true);
    const inRoom = new THREE.Matrix4().copy(root.matrixWorld).invert();
    const seen = (point) => {
      const at = root.localToWorld(new THREE.Vector3(...point)).project(camera);
      return [(1 + at.x) / 2 * canvas.clientWidth, (1 - at.y) / 2 * canvas.clientHeight];
    };
    return {
      ground: floor.position.z, sun, seen, still: isStill(),
      camera: camera.position.clone().applyMatrix4(inRoom).toArray(),
      target: controls.target.clone().applyMatrix4(inRoom).toArray(),
    };
  };
})();
