"use strict";
// The 3-D view of the machine as it is now, and the reference as a ghost.
(() => {
  const GS = GoughStewart, { scene, live } = GS.page;
  GS.liveStage = (element) => {
    const turned = new THREE.Quaternion(), angles = new THREE.Euler();
    // R = Rz Ry Rx, as design says of orientations
    const pose = (values, to, at) => {
      turned.setFromEuler(angles.set(values[3], values[4], values[5], "ZYX"));
      to.set([values[0], values[1], values[2], turned.x, turned.y, turned.z, turned.w], at);
    };
    // two frames for the room that the view needs; the first is then that of now
    const frames = 3, record = {
      ...scene, index: 0, run: 0, name: "", time: new Float64Array([0, 1, 2]), pose: new Float64Array(7 * frames),
      home: null, reference: new Float64Array(7 * frames), force: new Float64Array(6 * frames).fill(live.forceLimit || 1),
      nearness: { of: ["stroke", "force"], values: new Float64Array(6 * frames) }, external_force: new Float64Array(3 * frames).fill(1),
      orientation: null,
    };
    const far = live.behind?.pose ?? [];
    [0, 1, -1].forEach((sign, k) => {
      const near = live.home.map((x, axis) => (axis < 3 ? x + sign * 0.8 * live.reach[axis] : x));
      const at = (k && far.at([0, -1, Math.floor(far.length / 2)][k])) || near;
      pose(at, record.pose, 7 * k);
      pose(at, record.reference, 7 * k);
    });
    record.home = [...record.pose.subarray(0, 7)];
    GS.records.push(record);
    GS.prepareColours();
    GS.prepareBodies();
    GS.prepareScene();
    const view = GS.scene(element);
    view.colourBy("nearness");
    view.show(0); // colours of instances have to be there at the first picture
    view.showParts({ reference: !live.isOpen, path: false, frames: true });
    const [low, high] = live.stroke || [0, 0];
    return {
      view,
      colourBy: (kind) => { view.colourBy(kind); },
      // of a point: time, pose, lengths, forces, reference
      show: (point, push) => {
        pose(point.subarray(1, 7), record.pose, 0);
        if (Number.isFinite(point[19])) pose(point.subarray(19, 25), record.reference, 0);
        for (let leg = 0; leg < 6; leg++) {
          const force = point[13 + leg], length = point[7 + leg];
          record.force[leg] = force;
          const near = live.stroke ? Math.abs(length - (low + high) / 2) / ((high - low) / 2) : 0;
          record.nearness.values[leg] = Math.max(near, live.forceLimit ? Math.abs(force) / live.forceLimit : 0);
        }
        record.external_force.set(push, 0);
        view.show(0);
      },
    };
  };
})();
