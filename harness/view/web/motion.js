"use strict";
// Poses as they are drawn: between frames, and larger than they were.
(() => {
  const GS = GoughStewart;
  const next = new THREE.Quaternion(), home = new THREE.Quaternion(), axis = new THREE.Vector3();

  // q becomes exp(factor log(q q₀⁻¹)) q₀: the rotation vector from home, so many times larger.
  const larger = (q, from, factor) => {
    q.multiply(next.copy(from).conjugate());
    // of the two quaternions of a rotation, the one of the smaller angle
    if (q.w < 0) q.set(-q.x, -q.y, -q.z, -q.w);
    const sine = axis.set(q.x, q.y, q.z).length();
    if (sine > 0) q.setFromAxisAngle(axis.divideScalar(sine), factor * 2 * Math.atan2(sine, q.w));
    return q.multiply(from);
  };

  // Puts an object at the pose of a moment, its displacement from home drawn so many times larger.
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
