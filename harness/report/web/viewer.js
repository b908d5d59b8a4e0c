"use strict";
// An orbit camera, turned by mouse, touch or keys. Up is y for the camera, and z in the room.
(() => {
  const NEAREST = 0.1, FARTHEST = 50, STEP = Math.PI / 36;

  // Turns, moves and zooms; keeps the camera and its target above the height `lowest`.
  GoughStewart.orbit = (element, camera, changed) => {
    const target = new THREE.Vector3(), offset = new THREE.Vector3(), axis = new THREE.Vector3(), ball = new THREE.Spherical();
    const controls = { target, lowest: -Infinity, home: () => {} };
    const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
    const update = (change = () => {}) => {
      ball.setFromVector3(offset.copy(camera.position).sub(target));
      change();
      ball.makeSafe();
      ball.radius = clamp(ball.radius, NEAREST, FARTHEST);
      target.y = Math.max(target.y, controls.lowest);
      // the height of the camera is that of the target plus r cos φ
      const steepest = Math.acos(clamp((controls.lowest - target.y) / ball.radius, -1, 1));
      ball.phi = Math.min(ball.phi, steepest);
      camera.position.copy(target).add(offset.setFromSpherical(ball));
      camera.lookAt(target);
      changed();
    };
    const turn = (theta, phi) => update(() => {
      ball.theta -= theta;
      ball.phi -= phi;
    });
    const zoom = (factor) => update(() => { ball.radius *= factor; });
    const move = (dx, dy) => {
      const metres = 2 * camera.position.distanceTo(target) * Math.tan(camera.fov * Math.PI / 360) / element.clientHeight;
      camera.updateMatrix();
      [[0, -dx], [1, dy]].forEach(([column, pixels]) => {
        axis.setFromMatrixColumn(camera.matrix, column).multiplyScalar(pixels * metres);
        target.add(axis);
        camera.position.add(axis);
      });
      update();
    };

    // last position of each finger or of the mouse
    const fingers = new Map();
    const middle = () => [0, 1].map((k) => [...fingers.values()].reduce((sum, at) => sum + at[k], 0) / fingers.size);
    const apart = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    const before = { position: new THREE.Vector3(), target: new THREE.Vector3() };
    element.addEventListener("pointerdown", (event) => {
      if (!fingers.size) {
        before.position.copy(camera.position);
        before.target.copy(target);
      }
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const from = middle(), gap = fingers.size === 2 ? apart() : 0;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      const to = middle(), dx = to[0] - from[0], dy = to[1] - from[1];
      const moves = fingers.size > 1 || event.buttons & 2 || event.ctrlKey || event.metaKey || event.shiftKey;
      if (moves) move(dx, dy);
      else turn(2 * Math.PI * dx / element.clientHeight, 2 * Math.PI * dy / element.clientHeight);
      if (gap > 0 && apart() > 0) zoom(gap / apart());
    });
    element.addEventListener("pointerup", (event) => fingers.delete(event.pointerId));
    // the browser takes over the touch to scroll the page: undo the turn so far
    element.addEventListener("pointercancel", () => {
      fingers.clear();
      camera.position.copy(before.position);
      target.copy(before.target);
      update();
    });
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      zoom(event.deltaY > 0 ? 1 / 0.95 : 0.95);
    }, { passive: false });

    // The camera moves in the direction of the arrow. Elsewhere on the page, arrows step from frame to frame.
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    element.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const [x, y] = arrows[event.key] || [0, 0];
      if (arrows[event.key]) {
        if (event.shiftKey) move(-x * element.clientHeight / 24, y * element.clientHeight / 24);
        else turn(-x * STEP, y * STEP);
      } else if (event.key === "+" || event.key === "=") zoom(0.9);
      else if (event.key === "-" || event.key === "_") zoom(1 / 0.9);
      else if (event.key === "Home") controls.home();
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
    return Object.assign(controls, { update });
  };
})();

// The canvas of the 3-D view: renderer, room and camera.
(() => {
  const GS = GoughStewart;
  const FOV = 36, REST = 300;

  // Whether rendering is in software, by the renderer's name; null if there is none.
  GS.software = () => {
    const gl = document.createElement("canvas").getContext("webgl"), more = gl?.getExtension("WEBGL_debug_renderer_info");
    if (!gl) return null;
    const name = more ? gl.getParameter(more.UNMASKED_RENDERER_WEBGL) : "";
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return /SwiftShader|llvmpipe|softpipe|Basic Render|software/i.test(name);
  };

  // What the colours of the view mean: a title, colours from low to high, and what the ends are.
  GS.colourKey = (title, colours, ends) => {
    const key = document.getElementById("legend"), texts = [title, ...ends];
    key.querySelector("i").style.background = `linear-gradient(90deg,${colours.join(",")})`;
    key.querySelectorAll("b, span").forEach((part, k) => { part.textContent = texts[k]; });
  };

  GS.viewer = (element) => {
    const soft = GS.software();
    if (soft === null) throw new Error("no context");
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
    const controls = GS.orbit(canvas, camera, changed);
    // Looks at a target from a direction, far enough to see a ball around it, also in a narrow view.
    const fit = (target, direction, radius) => {
      const narrow = Math.min(element.clientWidth / element.clientHeight, 1) || 1;
      controls.target.copy(target);
      camera.position.copy(direction).setLength(radius / Math.sin(camera.fov * Math.PI / 360) / narrow).add(target);
      controls.update();
    };
    return { soft, renderer, canvas, room, camera, changed, moved, copy, render, isStill, coarser, controls, fit };
  };
})();
