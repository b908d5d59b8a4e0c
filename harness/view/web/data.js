"use strict";
// The records of the page, and poses between their frames.
(() => {
  const { numbers, page } = GoughStewart;
  const read = (scene, index) => {
    const record = { ...scene, index };
    for (const name of ["time", "pose", "reference", "orientation", "length", "force", "external_force"]) {
      record[name] = scene[name] && numbers(scene[name]);
    }
    if (scene.nearness) record.nearness = { of: scene.nearness.of, values: numbers(scene.nearness.values) };
    return record;
  };
  GoughStewart.records = page.scenes.map(read);
  GoughStewart.start = Math.min(...GoughStewart.records.map((r) => r.time[0]));
  GoughStewart.end = Math.max(...GoughStewart.records.map((r) => r.time[r.time.length - 1]));

  // The frame at or before a time, and the share of the way to the next one, 0 to 1.
  GoughStewart.frameAt = (record, time) => {
    const t = record.time;
    let low = 0, high = t.length - 1;
    if (time >= t[high]) return { frame: high, share: 0 };
    if (time <= t[0]) return { frame: 0, share: 0 };
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle; else high = middle;
    }
    return { frame: low, share: (time - t[low]) / (t[high] - t[low]) };
  };

  // Values between two frames, interpolated linearly; at a frame, exactly its own.
  GoughStewart.between = (values, size, at) => {
    const from = at.frame * size;
    return Array.from({ length: size }, (_, k) => {
      const a = values[from + k];
      return at.share === 0 ? a : a + at.share * (values[from + size + k] - a);
    });
  };
})();
