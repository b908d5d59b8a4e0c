"use strict";
// The canvas of the 3-D view: renderer, room and camera.
(() => {
  const GS = GoughStewart;
  const FOV = 36, REST = 300;

  // Whether rendering is in software, by the renderer's name.
  GS.software = () => {
    const gl = document.createElement("canvas").getContext("webgl"), more = gl && gl.getExtension("WEBGL_debug_renderer_info");
    const name = more ? gl.getParameter(more.UNMASKED_RENDERER_WEBGL) : "";
    if (gl) gl.getExtension("WEBGL_lose_context")?.loseContext();
    return /SwiftShader|llvmpipe|softpipe|Basic Render|software/i.test(name);
  };

  GS.viewer = (element) => {
    const soft = GS.software();
    // Without a graphics card, smooth edges cost as much as all else. Those of bodies wait until nothing moves.
    const renderer = new THREE.WebGLRenderer({ antialias: !soft, alpha: true });
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = soft ? THREE.BasicShadowMap : THREE.PCFShadowMap;
    // shadows are redrawn if an object has moved, not if only the camera has
    renderer.shadowMap.autoUpdate = false;
    const canvas = renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3-D view of the platform");
    canvas.setAttribute("aria-describedby", "view-keys");
    element.appendChild(canvas);
    const room = new THREE.Scene(), camera = new THREE.PerspectiveCamera(FOV, 1, 0.02, 100);
    room.rotateX(-Math.PI / 2);
    const sharpest = Math.min(window.devicePixelRatio, 2) * (soft ? 2 : 1);
    const ratios = { moving: soft ? Math.min(window.devicePixelRatio, 1) : sharpest, still: sharpest };
    let stale = true, changedAt = 0;
    const changed = () => {
      stale = true;
      changedAt = performance.now();
    };
    const moved = () => {
      renderer.shadowMap.needsUpdate = true;
      changed();
    };
    const draw = (sharp) => {
      const ratio = ratios[sharp ? "still" : "moving"];
      if (renderer.getPixelRatio() !== ratio) renderer.setPixelRatio(ratio);
      renderer.render(room, camera);
      stale = false;
    };
    // The present view on a canvas of its own, on the ground of the theme: to save and for paper.
    const copy = (to = document.createElement("canvas")) => {
      draw(true);
      Object.assign(to, { width: canvas.width, height: canvas.height });
      const pen = to.getContext("2d");
      pen.fillStyle = GS.theme().paper;
      pen.fillRect(0, 0, to.width, to.height);
      pen.drawImage(canvas, 0, 0);
      return to;
    };
    // Draws if something has changed; at full resolution once motion has stopped.
    const render = () => {
      const rests = performance.now() - changedAt > REST && renderer.getPixelRatio() < ratios.still;
      if (stale || rests) draw(!stale);
    };
    const isStill = () => !stale && renderer.getPixelRatio() >= ratios.still;
    // Reduces the resolution during motion; false if it is at its minimum.
    const coarser = () => {
      const { moving } = ratios;
      ratios.moving = Math.max(0.6, 0.75 * moving);
      return ratios.moving < moving;
    };
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
    return { soft, renderer, canvas, room, camera, changed, moved, copy, render, isStill, coarser, controls: GS.orbit(canvas, camera, changed) };
  };
})();
