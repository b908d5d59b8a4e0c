"use strict";
// Poses as drawn: between frames, and with enlarged motion.
(() => {
  const GS = GoughStewart;
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
