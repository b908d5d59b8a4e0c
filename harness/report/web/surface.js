"use strict";
// A closed surface over three coordinates in a box with its ends, coloured by a value, and the slice that the maps show.
(() => {
  const GS = GoughStewart, { page } = GS, [surface] = page.surfaces, $ = (id) => document.getElementById(id);
  const SIZE = 1.9;

  const build = async () => {
    const [vertices, triangles, values] = await Promise.all(["vertices", "triangles", "values"].map((name) => GS.array(surface[name])));
    const viewer = GS.viewer($("view")), root = new THREE.Group(), { axes, of } = surface;
    viewer.canvas.setAttribute("aria-label", `${surface.title}, over ${axes.map((axis) => axis.name).join(", ")}, coloured by ${of.name}`);
    // lengths of one unit have one scale; others fill the box
    const extent = axes.map((axis) => axis.high - axis.low), isOne = axes.every((axis) => axis.unit === axes[0].unit);
    const scale = extent.map((size) => SIZE / (isOne ? Math.max(...extent) : size)), half = extent.map((size, k) => size * scale[k] / 2);
    const inBox = (value, k) => (value - axes[k].low) * scale[k] - half[k];

    const isLog = of.scale === "log", shown = (v) => (isLog ? Math.log10(v) : v), finite = [...values].filter(Number.isFinite);
    const ends = [Math.min(...finite.slice(0, 1)), Math.max(...finite.slice(0, 1))];
    for (const v of finite) { ends[0] = Math.min(ends[0], v); ends[1] = Math.max(ends[1], v); }
    const colours = GS.heatColours(), [low, high] = ends.map(shown);
    const position = new Float32Array(vertices.length), colour = new Float32Array(vertices.length), paint = new THREE.Color();
    for (let k = 0; k < vertices.length; k++) position[k] = inBox(vertices[k], k % 3);
    values.forEach((v, k) => {
      const share = Math.min(Math.max((shown(v) - low) / (high - low || 1), 0), 1), rgb = colours[Math.round(255 * share)];
      paint.setRGB(...rgb);
      colour.set([paint.r, paint.g, paint.b], 3 * k);
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
    geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(triangles), 1));
    geometry.computeVertexNormals();
    const body = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true }));
    const box = new THREE.LineSegments(new THREE.EdgesGeometry(new THREE.BoxGeometry(...half.map((h) => 2 * h))), new THREE.LineBasicMaterial());
    const sheet = new THREE.Mesh(new THREE.PlaneGeometry(2 * half[0], 2 * half[1]), new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.22, side: THREE.DoubleSide, depthWrite: false }));
    root.add(body, box, sheet);

    // Ends and names along the edges that face the camera at first.
    const number = (axis, v) => GS.short(v * axis.factor), air = 0.14;
    const edges = [(t) => [t, -half[1] - air, -half[2] - air], (t) => [half[0] + air, t, -half[2] - air], (t) => [-half[0] - air, -half[1] - air, t]];
    const texts = axes.flatMap((axis, k) => [[number(axis, axis.low), -0.9 * half[k]], [axis.unit ? `${axis.name} [${axis.unit}]` : axis.name, 0], [number(axis, axis.high), 0.9 * half[k]]].map(([text, t]) => {
      const made = GS.shapes.label(text, "#000", 0.14);
      made.position.set(...edges[k](t));
      return made;
    }));
    root.add(...texts);
    const sun = new THREE.DirectionalLight(0xffffff, 0.38), sky = new THREE.HemisphereLight(0xffffff, 0xd8dce2, 0.62);
    sun.position.set(2, -4, 5);
    viewer.room.add(root, sun, sky);

    viewer.controls.home = () => viewer.fit(new THREE.Vector3(), new THREE.Vector3(0.55, 0.42, 0.85), Math.hypot(...half) + 0.2);
    viewer.controls.home();
    const dress = ({ ink, roles }) => {
      for (const text of texts) text.paint(ink);
      box.material.color.set(ink);
      sheet.material.color.set(roles.actual);
      viewer.changed();
    };
    dress(GS.theme());
    GS.onTheme(dress);
    const chart = page.charts.find((each) => each.map?.slices), slices = chart && await GS.array(chart.map.slices.values);
    const cut = () => {
      sheet.visible = Boolean(slices);
      if (slices) sheet.position.z = inBox(slices[GS.sliceOf(chart)], 2);
      viewer.changed();
    };
    cut();
    GS.on("slice", cut);

    const told = ends.map((v) => `${GS.short(v * of.factor, of.digits)} ${of.unit}`.trim());
    GS.colourKey(of.name, GS.HEAT_STOPS, told);

    // Paper: the present view with the scale of its colours.
    GS.printStage = () => {
      dress(GS.theme());
      const { width, height: down } = viewer.copy($("printed")), pen = $("printed").getContext("2d"), unit = width / 100;
      colours.forEach((c, k) => { pen.fillStyle = GS.css(c); pen.fillRect(unit + k * 28 * unit / 256, down - 5 * unit, 28 * unit / 256 + 1, unit); });
      Object.assign(pen, { fillStyle: GS.theme().ink, font: `${1.6 * unit}px system-ui, sans-serif` });
      pen.fillText(of.name, unit, down - 5.8 * unit);
      pen.fillText(told[0], unit, down - 2 * unit);
      pen.textAlign = "right";
      pen.fillText(told[1], 29 * unit, down - 2 * unit);
    };
    addEventListener("afterprint", () => dress(GS.theme()));
    const tick = () => { requestAnimationFrame(tick); viewer.render(); };
    tick();
    // what is drawn, for tests
    GS.surface = { triangles: triangles.length / 3, vertices: vertices.length / 3, height: () => sheet.position.z, pixels: () => viewer.renderer.info.render.triangles };
  };
  build().catch((problem) => {
    $("no-view").hidden = false;
    $("no-view").textContent = `This browser shows no 3-D graphics (WebGL): ${problem.message || problem}. Maps and tables work without.`;
  });
})();
