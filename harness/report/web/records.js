"use strict";
// The scenes of the page, and poses between their frames.
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
})();
