"use strict";
// Shapes of the 3-D view: tubes, plates, lines, labels, coordinate frames; merges several into one geometry.
(() => {
  const GS = GoughStewart;
  const UP = new THREE.Vector3(0, 0, 1);
  const vector = (a) => new THREE.Vector3(a[0], a[1], a[2]);
  const mean = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);

  // Lighting per vertex: without a graphics card it takes a tenth of the time of lighting per pixel.
  const material = (colour, more = {}) => new THREE.MeshLambertMaterial({ color: colour, ...more });

  // A tube from z = 0 to z = length, and a cone with its tip at z = 0.
  const tube = (radius, length, sides = 14) => new THREE.CylinderGeometry(radius, radius, length, sides).rotateX(Math.PI / 2).translate(0, 0, length / 2);
  const cone = (radius, length) => new THREE.ConeGeometry(radius, length, 14).rotateX(Math.PI / 2).translate(0, 0, -length / 2);

  // Merges indexed geometries, to draw them in one call. Each may have its own colour.
  const merged = (geometries, colours = null) => {
    const parts = { position: [], normal: [], ...(colours && { color: [] }) }, index = [];
    geometries.forEach((geometry, k) => {
      const first = parts.position.length / 3, { position, normal } = geometry.attributes;
      for (const i of geometry.index.array) index.push(first + i);
      for (const x of position.array) parts.position.push(x);
      for (const x of normal.array) parts.normal.push(x);
      if (colours) for (let i = 0; i < position.count; i++) parts.color.push(...new THREE.Color(colours[k]).toArray());
    });
    const whole = new THREE.BufferGeometry();
    for (const [name, values] of Object.entries(parts)) whole.setAttribute(name, new THREE.Float32BufferAttribute(values, 3));
    whole.setIndex(index);
    return whole;
  };

  // Convex outline of points seen along z, in order (Andrew's monotone chain).
  const outline = (points) => {
    const sorted = points.map((p) => [p[0], p[1]]).sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const turn = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    const half = (list) => {
      const kept = [];
      for (const p of list) {
        while (kept.length > 1 && turn(kept[kept.length - 2], kept[kept.length - 1], p) <= 0) kept.pop();
        kept.push(p);
      }
      kept.pop();
      return kept;
    };
    return [...half(sorted), ...half([...sorted].reverse())];
  };

  // A plate under (side −1) or over (side 1) the joints, with its edge at a margin outside them.
  const plate = (points, thickness, side, edge) => {
    const [cx, cy, cz] = mean(points), bevel = 0.25 * thickness;
    const corners = outline(points).map(([x, y]) => {
      const away = 1 + edge / Math.max(Math.hypot(x - cx, y - cy), 0.3 * edge);
      return new THREE.Vector2(cx + (x - cx) * away, cy + (y - cy) * away);
    });
    const geometry = new THREE.ExtrudeGeometry(new THREE.Shape(corners), {
      depth: thickness, bevelEnabled: true, bevelSize: bevel, bevelThickness: bevel, bevelSegments: 2,
    });
    geometry.translate(0, 0, side < 0 ? cz - thickness : cz);
    return geometry;
  };

  // A curve that also shows, faintly, through bodies. It is not depth-tested, so bodies never hide it fully.
  const curve = (points, colour, order, dash = null) => {
    const geometry = new THREE.BufferGeometry().setFromPoints(points), group = new THREE.Group();
    for (const [opacity, depthTest] of [[0.4, false], [1, true]]) {
      const more = { color: colour, transparent: true, opacity, depthTest, depthWrite: false };
      const paint = dash ? new THREE.LineDashedMaterial({ ...more, dashSize: dash, gapSize: dash }) : new THREE.LineBasicMaterial(more);
      const line = new THREE.Line(geometry, paint);
      line.renderOrder = order;
      if (dash) line.computeLineDistances();
      group.add(line);
    }
    return group;
  };

  // A text of this height that faces the camera; `paint` changes its colour.
  const label = (text, colour, height) => {
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), font = "600 44px system-ui, sans-serif";
    pen.font = font;
    canvas.width = Math.max(64, Math.ceil(pen.measureText(text).width) + 12);
    canvas.height = 64;
    const map = new THREE.CanvasTexture(canvas), sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
    sprite.scale.set(height * canvas.width / 64, height, 1);
    sprite.paint = (paint) => {
      pen.clearRect(0, 0, canvas.width, 64);
      Object.assign(pen, { font, textAlign: "center", textBaseline: "middle", fillStyle: paint });
      pen.fillText(text, canvas.width / 2, 34);
      map.needsUpdate = true;
    };
    sprite.paint(colour);
    return sprite;
  };

  // Three axes, visible through bodies.
  const AXES = { light: [0xc0392b, 0x2e8b57, 0x2563a8], dark: [0xff7b6b, 0x5fca8f, 0x79b4f5] };
  const frame = (length, names, unit) => {
    const group = new THREE.Group(), bodies = [], labels = [];
    names.forEach((name, k) => {
      const direction = new THREE.Vector3().setComponent(k, 1), turned = new THREE.Quaternion().setFromUnitVectors(UP, direction);
      const shaft = tube(0.22 * unit, length, 8), tip = cone(0.7 * unit, 2 * unit);
      tip.translate(0, 0, length + unit);
      bodies.push(...[shaft, tip].map((part) => part.applyQuaternion(turned)));
      labels.push(label(name, "#000", 5 * unit));
      labels[k].position.copy(direction).multiplyScalar(length + 3.6 * unit);
    });
    const paint = material(0xffffff, { vertexColors: true, depthTest: false, transparent: true });
    const body = new THREE.Mesh(new THREE.BufferGeometry(), paint);
    group.add(body, ...labels);
    for (const part of group.children) part.renderOrder = 10;
    group.paint = (dark) => {
      const colours = AXES[dark ? "dark" : "light"];
      body.geometry.dispose();
      body.geometry = merged(bodies, bodies.map((_, k) => colours[k >> 1]));
      labels.forEach((each, k) => each.paint(`#${colours[k].toString(16).padStart(6, "0")}`));
    };
    return group;
  };

  GS.shapes = { UP, vector, mean, material, tube, cone, merged, plate, curve, label, frame };
})();
