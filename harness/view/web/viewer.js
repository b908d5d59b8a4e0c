"use strict";
// The canvas of the 3-D view: renderer, room, camera, and the hand that turns it. The camera's own y is up, the room's z.
(() => {
  const GS = GoughStewart;
  const NEAREST = 0.1, FARTHEST = 50, FOV = 36;

  // A camera about a target: drag turns it, right drag moves both, the wheel or two fingers change its distance.
  const orbit = (element, camera, changed) => {
    const target = new THREE.Vector3(), offset = new THREE.Vector3(), axis = new THREE.Vector3(), ball = new THREE.Spherical();
    const update = (change = () => {}) => {
      ball.setFromVector3(offset.copy(camera.position).sub(target));
      change();
      ball.makeSafe();
      ball.radius = Math.min(Math.max(ball.radius, NEAREST), FARTHEST);
      camera.position.copy(target).add(offset.setFromSpherical(ball));
      camera.lookAt(target);
      changed();
    };
    const turn = (dx, dy) => update(() => {
      ball.theta -= 2 * Math.PI * dx / element.clientHeight;
      ball.phi -= 2 * Math.PI * dy / element.clientHeight;
    });
    const zoom = (factor) => update(() => { ball.radius *= factor; });
    const move = (dx, dy) => {
      const metres = 2 * camera.position.distanceTo(target) * Math.tan(camera.fov * Math.PI / 360) / element.clientHeight;
      [[0, -dx], [1, dy]].forEach(([column, pixels]) => {
        axis.setFromMatrixColumn(camera.matrix, column).multiplyScalar(pixels * metres);
        target.add(axis);
        camera.position.add(axis);
      });
      update();
    };

    // where each finger, or the mouse, was last
    const fingers = new Map();
    const middle = () => [0, 1].map((k) => [...fingers.values()].reduce((sum, at) => sum + at[k], 0) / fingers.size);
    const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    element.addEventListener("pointerdown", (event) => {
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const before = middle(), gap = fingers.size === 2 ? apart() : 0;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      const after = middle(), moves = fingers.size > 1 || event.buttons & 2 || event.ctrlKey || event.metaKey || event.shiftKey;
      (moves ? move : turn)(after[0] - before[0], after[1] - before[1]);
      if (gap > 0 && apart() > 0) zoom(gap / apart());
    });
    for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, (event) => fingers.delete(event.pointerId));
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(event.deltaY > 0 ? 1 / 0.95 : 0.95);
    }, { passive: false });
    return { target, update };
  };

  GS.viewer = (element) => {
    const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    element.appendChild(renderer.domElement);
    const room = new THREE.Scene(), camera = new THREE.PerspectiveCamera(FOV, 1, 0.02, 100);
    room.rotateX(-Math.PI / 2);
    let stale = true;
    const changed = () => { stale = true; };
    const resize = () => {
      const width = element.clientWidth, height = element.clientHeight;
      if (!width || !height) return;
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
      renderer.setSize(width, height);
      changed();
    };
    new ResizeObserver(resize).observe(element);
    resize();
    return {
      renderer, room, camera, changed,
      controls: orbit(renderer.domElement, camera, changed),
      render: () => {
        if (stale) renderer.render(room, camera);
        stale = false;
      },
    };
  };
})();
