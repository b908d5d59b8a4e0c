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

  const next = new THREE.Quaternion(), home = new THREE.Vector3();

  // Sets an object to its pose at a time, with the displacement from home times the factor.
  GS.place = (object, values, record, at, factor) => {
    const from = 7 * at.frame, { position, quaternion } = object;
    position.fromArray(GS.between(values, 7, at));
    quaternion.fromArray(values, from + 3);
    if (at.share > 0) quaternion.slerp(next.fromArray(values, from + 10), at.share);
    if (factor !== 1) {
      position.sub(home.fromArray(record.home)).multiplyScalar(factor).add(home);
      // exp(factor log(q q₀⁻¹)) q₀: of the smaller angle from home, factor times as much
      next.copy(quaternion);
      quaternion.fromArray(record.home, 3).slerp(next, factor);
    }
    object.updateMatrix();
  };
})();

// Colours of the legs, and their scale.
GoughStewart.prepareColours = () => {
  const GS = GoughStewart;
  const PUSH = [0.84, 0.37, 0.0], PULL = [0.0, 0.45, 0.7], REST = [0.80, 0.83, 0.86], PLAIN = [0.62, 0.67, 0.72];
  const { rgb, mix } = GS, nearnessColour = GS.gradient(GS.page.nearness.stops), beyond = rgb(GS.page.nearness.beyond);
  const byForce = (force, largest) => {
    const share = Math.min(Math.abs(force) / largest, 1);
    return mix(REST, force < 0 ? PULL : PUSH, Math.sqrt(share));
  };
  const byNearness = (near) => (near > 1 + 1e-9 ? beyond : nearnessColour(near));
  const LARGEST = GS.records.reduce((most, r) => (r.force || []).reduce((m, f) => Math.max(m, Math.abs(f)), most), 1e-12);
  const PALE = 0.82;
  const plain = (kind, record, at, leg) => {
    if (kind === "run") return rgb(GS.theme().six[record.run % 6]);
    if (kind === "force" && record.force) return byForce(record.force[6 * at.frame + leg], LARGEST);
    if (kind === "nearness" && record.nearness) return byNearness(record.nearness.values[6 * at.frame + leg]);
    return PLAIN;
  };
  // Legs that are not picked step back.
  GS.legColour = (kind, record, at, leg) => {
    const colour = plain(kind, record, at, leg), { leg: picked } = GS.state;
    return picked === null || picked === leg + 1 ? colour : mix(colour, GS.theme().dark ? [0.16, 0.19, 0.23] : [0.93, 0.94, 0.95], PALE);
  };
  const evenly = (n) => Array.from({ length: n }, (_, k) => k / (n - 1));
  // Title of the scale, its colours from low to high, and labels of its ends; undefined if there is no scale.
  GS.scale = (kind) => {
    if (kind === "force") {
      const colours = evenly(17).map((share) => byForce((2 * share - 1) * LARGEST, LARGEST));
      return { title: "actuator force", colours, low: `pulls ${GS.text(-LARGEST)} N`, high: `pushes ${GS.text(LARGEST)} N` };
    }
    const limits = [...new Set(GS.records.flatMap((r) => (r.nearness ? r.nearness.of : [])))].join(", ");
    if (kind !== "nearness" || !limits) return null;
    return { title: `nearest of ${limits}`, colours: evenly(21).map(byNearness), low: "middle", high: "limit" };
  };
};

// The values at the present time: a table per run with its pose, and force and length of each leg.
(() => {
  const GS = GoughStewart, { fixed } = GS;

  // Returns a function that fills the values of a time into the tables in an element, one for each run.
  GS.moment = (host) => {
    const tables = GS.records.map((record, k) => {
      const table = host.children[k], [dots, cells] = ["i", "td span"].map((part) => [...table.querySelectorAll(part)]);
      return { record, caption: table.caption, dots, cells, title: GS.records.length > 1 ? `${record.name}: ` : "" };
    });
    return (time, colour) => {
      for (const { record, caption, dots, cells, title } of tables) {
        const at = GS.frameAt(record, time), length = GS.between(record.length, 6, at);
        const [x, y, z] = GS.between(record.pose, 7, at).slice(0, 3).map((v) => fixed(v, record.digits));
        const turned = record.orientation ? GS.between(record.orientation, 3, at).map((v) => `${fixed(180 / Math.PI * v, record.digits - 2)}°`) : null;
        caption.textContent = `${title}x ${x}  y ${y}  z ${z} m${turned ? `   roll ${turned[0]}  pitch ${turned[1]}  yaw ${turned[2]}` : ""}`;
        for (let k = 0; k < 6; k++) {
          dots[k].style.background = GS.css(GS.legColour(colour, record, at, k));
          const texts = [
            ...(record.force ? [GS.text(record.force[6 * at.frame + k])] : []), length[k].toFixed(record.digits),
            ...(record.nearness ? [(100 * record.nearness.values[6 * at.frame + k]).toFixed(0)] : []),
          ];
          texts.forEach((text, row) => { cells[6 * row + k].textContent = text; });
        }
      }
    };
  };
})();
