"use strict";
// The 3-D view: machines in a room, put where a moment has them.
(() => {
  const GS = GoughStewart;
  const { vector, frame, machine, unit, extent, SIZE, MIDDLE, room, UP } = GS.bodies;
  const quaternion = new THREE.Quaternion(), next = new THREE.Quaternion(), direction = new THREE.Vector3(), point = new THREE.Vector3();
  const place = (object, values, at) => {
    const from = 7 * at.frame;
    object.position.fromArray(GS.between(values, 7, at));
    quaternion.fromArray(values, from + 3);
    if (at.share > 0) quaternion.slerp(next.fromArray(values, from + 10), at.share);
    object.quaternion.copy(quaternion);
    object.updateMatrix();
  };

  GS.scene = (element) => {
    const viewer = GS.viewer(element);
    const scale = 1.1 / SIZE, root = new THREE.Group();
    root.scale.setScalar(scale);
    root.position.copy(vector(MIDDLE)).multiplyScalar(-scale);
    const machines = GS.records.map(machine);
    root.add(...machines.map((m) => m.group));
    // a hanging platform has some air below it
    const hangs = GS.records.some((r) => r.pose[2] < MIDDLE[2]);
    const ground = room.low - (hangs ? 0.4 * SIZE : 2.8 * unit);
    const floor = new THREE.Mesh(new THREE.CircleGeometry(3.2 * SIZE, 64), new THREE.ShadowMaterial({ opacity: 0.16 }));
    floor.position.set(MIDDLE[0], MIDDLE[1], ground);
    floor.receiveShadow = true;
    const cell = 10 ** Math.round(Math.log10(SIZE / 4)), cells = 2 * Math.ceil(2.2 * SIZE / cell / 2);
    const grid = new THREE.GridHelper(cells * cell, cells, 0xc3cbd4, 0xdde3e9);
    grid.rotateX(Math.PI / 2);
    grid.position.copy(floor.position);
    const world = frame(0.42 * SIZE, ["X", "Y", "Z"]);
    root.add(floor, grid, world);
    const sun = new THREE.DirectionalLight(0xffffff, 0.75), sky = new THREE.HemisphereLight(0xffffff, 0xc8ccd2, 0.62);
    sun.position.set(2.2 * SIZE, -1.6 * SIZE, 5 * SIZE).add(vector(MIDDLE));
    sun.target.position.copy(vector(MIDDLE));
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    sun.shadow.radius = 3;
    // in the units of the room
    Object.assign(sun.shadow.camera, { left: -2.6, right: 2.6, top: 2.6, bottom: -2.6, near: 0.1, far: 14 });
    root.add(sun, sun.target, sky);
    viewer.room.add(root);

    // The camera lives in a frame whose y is up: (x, z, −y) of the room.
    const middle = scale * (0.5 * (ground + room.high) - MIDDLE[2]);
    const radius = scale * Math.hypot(Math.max(extent, 0.6 * extent + room.aside), 0.6 * (room.high - ground));
    const places = { corner: [0.62, 0.36, 0.70], front: [0, 0.12, 1], side: [1, 0.12, 0], top: [0, 1, 0.001] };
    const look = (from) => {
      const [x, y, z] = places[from], size = Math.hypot(x, y, z);
      const narrow = Math.min(element.clientWidth / element.clientHeight, 1) || 1;
      const away = 0.97 * radius / Math.sin(viewer.camera.fov * Math.PI / 360) / narrow;
      viewer.controls.target.set(0, middle, 0);
      viewer.camera.position.set(away * x / size, middle + away * y / size, away * z / size);
      viewer.controls.update();
    };

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
          leg.sleeve.material.color.setRGB(...GS.mixed(colour, [0.35, 0.38, 0.42], 0.25));
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
      viewer.changed();
    };
    look("corner");
    return {
      show, look,
      colourBy: (kind) => { shown = kind; },
      showGhosts: (on) => machines.forEach((m) => { if (m.ghost) m.ghost.visible = on; if (m.trails[1]) m.trails[1].visible = on && m.trails[0].visible; }),
      showTrails: (on) => machines.forEach((m) => m.trails.forEach((trail, k) => { trail.visible = on && (k === 0 || m.ghost.visible); })),
      showFrames: (on) => { world.visible = on; machines.forEach((m) => { m.frames.visible = on; }); },
      showMachine: (k, on) => { machines[k].group.visible = on; viewer.changed(); },
      simpler: () => {
        if (sun.castShadow) sun.castShadow = floor.visible = false;
        else if (viewer.renderer.getPixelRatio() > 0.6) {
          viewer.renderer.setPixelRatio(Math.max(0.6, 0.75 * viewer.renderer.getPixelRatio()));
        }
        viewer.changed();
      },
      render: viewer.render,
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
