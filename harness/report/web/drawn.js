"use strict";
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
