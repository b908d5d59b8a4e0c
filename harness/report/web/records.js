"use strict";
// The scenes of the page, poses between their frames, and poses as drawn, with enlarged motion.
(() => {
  const GS = GoughStewart, NAMES = { leg_length: "length", actuator_force: "force" };
  // Unpacks all scenes; `stage` builds what is drawn from them.
  GS.unpackScenes = async () => {
    for (const [index, scene] of GS.page.scenes.entries()) {
      const record = { ...scene, index, run: scene.run ?? index, reference: null, force: null, external_force: null, orientation: null };
      await Promise.all(Object.entries(scene.arrays).map(async ([name, number]) => { record[NAMES[name] || name] = await GS.array(number); }));
      if (record.nearness) record.nearness = { of: scene.nearnessOf, values: record.nearness };
      GS.records.push(record);
    }
  };

  // The frame at or before a time, and the share of the way to the next one, 0 to 1.
  GS.frameAt = (record, time) => {
    const t = record.time, frame = Math.max(GS.rowAt(t, time), 0);
    return { frame, share: frame < t.length - 1 ? Math.max(0, (time - t[frame]) / (t[frame + 1] - t[frame])) : 0 };
  };

  // Values between two frames, interpolated linearly; at a frame, exactly its own.
  GS.between = (values, size, at) => {
    const from = at.frame * size;
    return Array.from({ length: size }, (_, k) => {
      const a = values[from + k];
      return at.share === 0 ? a : a + at.share * (values[from + size + k] - a);
    });
  };

  const next = new THREE.Quaternion(), home = new THREE.Quaternion(), axis = new THREE.Vector3();

  // q becomes exp(factor log(q q₀⁻¹)) q₀: the rotation vector from home times the factor.
  const larger = (q, from, factor) => {
    q.multiply(next.copy(from).conjugate());
    // of the two quaternions of a rotation, the one with the smaller angle
    if (q.w < 0) q.set(-q.x, -q.y, -q.z, -q.w);
    const sine = axis.set(q.x, q.y, q.z).length();
    if (sine > 0) q.setFromAxisAngle(axis.divideScalar(sine), factor * 2 * Math.atan2(sine, q.w));
    return q.multiply(from);
  };

  // Sets an object to its pose at a time, with the displacement from home times the factor.
  GS.place = (object, values, record, at, factor) => {
    const from = 7 * at.frame, { position, quaternion } = object;
    position.fromArray(GS.between(values, 7, at));
    quaternion.fromArray(values, from + 3);
    if (at.share > 0) quaternion.slerp(next.fromArray(values, from + 10), at.share);
    if (factor !== 1) {
      position.sub(axis.fromArray(record.home)).multiplyScalar(factor).add(axis);
      larger(quaternion, home.fromArray(record.home, 3), factor);
    }
    object.updateMatrix();
  };
})();
