"use strict";
// The 3-D view of the machine as it is now, and the reference as a ghost.
(() => {
  const GS = GoughStewart, { live } = GS.page, FRAMES = 3;
  GS.liveStage = (element) => {
    const turned = new THREE.Quaternion(), angles = new THREE.Euler();
    // R = Rz Ry Rx
    const pose = (values, to, at) => {
      turned.setFromEuler(angles.set(values[3], values[4], values[5], "ZYX"));
      to.set([values[0], values[1], values[2], turned.x, turned.y, turned.z, turned.w], at);
    };
    // two frames for the room that the view needs; the first is then that of now
    const record = {
      ...live.scene, index: 0, run: 0, name: "", time: new Float64Array([0, 1, 2]), orientation: null,
      pose: new Float64Array(7 * FRAMES), reference: new Float64Array(7 * FRAMES),
      force: new Float64Array(6 * FRAMES).fill(live.forceLimit || 1), external_force: new Float64Array(3 * FRAMES).fill(1),
      nearness: { of: ["stroke", "force"], values: new Float64Array(6 * FRAMES) },
    };
    const far = live.behind?.pose ?? [];
    [0, 1, -1].forEach((sign, k) => {
      const near = live.home.map((x, axis) => (axis < 3 ? x + sign * 0.8 * live.reach[axis] : x));
      const at = (k && far.at([0, -1, Math.floor(far.length / 2)][k])) || near;
      for (const poses of [record.pose, record.reference]) pose(at, poses, 7 * k);
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
    const [low, high] = live.stroke || [-Infinity, Infinity], middle = (low + high) / 2;
    return {
      view,
      colourBy: view.colourBy,
      // of a point: time, pose, lengths, forces, reference
      show: (point, push) => {
        pose(point.subarray(1, 7), record.pose, 0);
        if (Number.isFinite(point[19])) pose(point.subarray(19, 25), record.reference, 0);
        for (let leg = 0; leg < 6; leg++) {
          const force = record.force[leg] = point[13 + leg], near = live.stroke ? Math.abs(point[7 + leg] - middle) / (high - middle) : 0;
          record.nearness.values[leg] = Math.max(near, live.forceLimit ? Math.abs(force) / live.forceLimit : 0);
        }
        record.external_force.set(push, 0);
        view.show(0);
      },
    };
  };
})();
