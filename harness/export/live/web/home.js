"use strict";
// What is taken home: the last minute as a record, the settings as an experiment, what was dragged as its reference.
(() => {
  const GS = GoughStewart, $ = (id) => document.getElementById(id);
  // TOML of plain values: tables after the keys of each, tables within arrays in line.
  const bare = (key) => (/^[\w-]+$/.test(key) ? key : JSON.stringify(key));
  const isTable = (value) => value !== null && typeof value === "object" && !Array.isArray(value);
  const item = (value) => {
    if (Array.isArray(value)) return `[${value.map(item).join(", ")}]`;
    if (isTable(value)) return `{ ${Object.entries(value).map(([key, each]) => `${bare(key)} = ${item(each)}`).join(", ")} }`;
    if (typeof value === "number") return Number.isFinite(value) ? String(value) : value > 0 ? "inf" : "-inf";
    return JSON.stringify(value);
  };
  const toml = (table, path = []) => {
    const entries = Object.entries(table).filter(([, value]) => value !== null && value !== undefined);
    const own = entries.filter(([, value]) => !isTable(value)).map(([key, value]) => `${bare(key)} = ${item(value)}\n`).join("");
    const head = path.length && (own || !entries.length) ? `\n[${path.map(bare).join(".")}]\n` : "";
    return head + own + entries.filter(([, value]) => isTable(value)).map(([key, value]) => toml(value, [...path, key])).join("");
  };

  const TABLE = Array.from({ length: 256 }, (_, n) => { for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1; return n >>> 0; });
  const checksum = (bytes) => { let c = 0xffffffff; for (const byte of bytes) c = TABLE[(c ^ byte) & 255] ^ (c >>> 8); return (c ^ 0xffffffff) >>> 0; };
  // A ZIP archive of texts or bytes by name: the fields of PKWARE's appnote, 4.3.7, 4.3.12 and 4.3.16.
  const archive = async (files) => {
    const parts = [], directory = [];
    let at = 0;
    const words = (...fields) => {
      const bytes = new Uint8Array(fields.reduce((sum, [, size]) => sum + size, 0)), view = new DataView(bytes.buffer);
      let place = 0;
      for (const [value, size] of fields) {
        if (size === 2) view.setUint16(place, value, true);
        else view.setUint32(place, value, true);
        place += size;
      }
      return bytes;
    };
    for (const [name, text] of Object.entries(files)) {
      const title = new TextEncoder().encode(name), raw = typeof text === "string" ? new TextEncoder().encode(text) : text;
      const packed = new Uint8Array(await new Response(new Blob([raw]).stream().pipeThrough(new CompressionStream("deflate-raw"))).arrayBuffer());
      const common = [[20, 2], [0x0800, 2], [8, 2], [0, 2], [0x21, 2], [checksum(raw), 4], [packed.length, 4], [raw.length, 4], [title.length, 2], [0, 2]];
      directory.push(words([0x02014b50, 4], [20, 2], ...common, [0, 2], [0, 2], [0, 2], [0, 4], [at, 4]), title);
      for (const part of [words([0x04034b50, 4], ...common), title, packed]) { parts.push(part); at += part.length; }
    }
    const size = directory.reduce((sum, part) => sum + part.length, 0), n = Object.keys(files).length;
    return new Blob([...parts, ...directory, words([0x06054b50, 4], [0, 2], [0, 2], [n, 2], [n, 2], [size, 4], [at, 4], [0, 2])], { type: "application/zip" });
  };

  const NAMES = ["position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity"];
  const STATES = NAMES.slice(0, 4);
  const numbered = (name) => Array.from({ length: name.startsWith("leg") || name.endsWith("force") || name.startsWith("flag") ? 6 : 3 }, (_, k) => `${name}[${k + 1}]`);
  GS.home = ({ engine, outside, hand, turning }) => {
    const { given } = engine, { taken, turn } = given;

    // The experiment with what differs from its file; C has said which gains are used.
    // What a hand cut or froze, as the experiment's table: times since the first row.
    const spans = (faults, begun, duration) => {
      const found = [], on = new Map();
      const time = (row) => Number(Math.max(0, row * given.plantStep - begun).toFixed(9));
      const end = (each, until) => {
        const at = time(each.row);
        if (at >= duration || until === at) return;
        const leg = each.place % 6 + 1, signal = each.place < 24 ? "leg_length" : "leg_velocity";
        if (each.place >= 6 && !given.reads.includes(signal)) return;
        const what = each.place < 6 ? { cut: [leg] } : { freeze: { [signal]: [leg] } };
        found.push({ at, ...(until === null || until >= duration ? {} : { duration: Number((until - at).toFixed(9)) }), ...what });
      };
      for (const each of faults) {
        if (on.has(each.place)) end(on.get(each.place), time(each.row));
        if (each.on) on.set(each.place, each);
        else on.delete(each.place);
      }
      for (const each of on.values()) end(each, null);
      return found;
    };
    const experiment = async (motion, duration, faults, first) => {
      const found = structuredClone(taken.experiment), { controller } = found, { used } = await engine.ask("used", "usedGains");
      const now = Object.fromEntries(turn.names.map((name, k) => [name, turning.now[k]])), then = Object.fromEntries(turn.names.map((name, k) => [name, turn.wanted[k]]));
      const differs = (...names) => names.some((name) => now[name] !== then[name]);
      const put = (table, key, value) => { (found[table] ??= {})[key] = value; };
      if (differs("proportional", "derivative", "integral") && used.length) {
        for (const key of ["bandwidth", "damping_ratio", "integral_time", "integral_gain"]) delete controller[key];
        controller.proportional_gain = used.slice(0, 6);
        controller.derivative_gain = used.slice(6, 12);
        if (turn.integral) controller.integral_gain = used.slice(12, 18);
        controller.derivative_filter = used[18];
      } else if (differs("bandwidth", "damping_ratio", "integral_time")) {
        for (const key of ["proportional_gain", "derivative_gain", "integral_gain"]) delete controller[key];
        controller.bandwidth = now.bandwidth;
        controller.damping_ratio = now.damping_ratio;
        if (turn.integral) controller.integral_time = now.integral_time;
      }
      if (differs("filter_time")) controller.derivative_filter = now.filter_time;
      if (differs("delay")) put("loop", "delay", now.delay);
      if (differs("force_limit")) put("actuators", "force_limit", now.force_limit ?? undefined);
      for (const key of ["noise", "quantisation"]) if (differs(key)) put("sensors", key, { ...found.sensors?.[key], leg_length: now[key] });
      const { mass, gravity } = outside();
      if (mass !== given.platformMass || gravity.some((g, k) => g !== given.g[k])) found.plant = { ...found.plant, parameters: { ...found.plant?.parameters, platform_mass: mass, gravity } };
      // a hand's loads add to those that the experiment changes
      for (const { parameters } of found.change || []) {
        if (parameters?.platform_mass !== undefined) parameters.platform_mass += mass - given.platformMass;
        if (parameters?.gravity) parameters.gravity = parameters.gravity.map((g, k) => g + gravity[k] - given.g[k]);
      }
      if (given.isOpen) controller.force = hand.wanted();
      if (faults.length) found.fault = [...(found.fault || []), ...faults];
      if (motion) found.reference = { type: "file", file: "reference.csv" };
      // it begins as the first row was: the ends of the reference's splines know its rates to 0.1 mm/s only
      if (motion || given.isOpen) found.start = Object.fromEntries(STATES.map((name, k) => [name, [...first.subarray(1 + 3 * k, 4 + 3 * k)]]));
      if (duration) put("loop", "duration", duration);
      return toml(found);
    };

    // Texts by name: a record of the rows that are kept, its metadata, the experiment, and its reference.
    const files = async () => {
      const { values, size, step, faults } = await engine.ask("kept", "keptRows"), all = values.length / size;
      // whole samples
      const rows = all - Math.max(all - 1, 0) % Math.max(1, Math.round(given.every * given.plantStep / step));
      if (!rows) throw new Error("nothing has run yet");
      const withReference = !given.isOpen, dragged = withReference && hand.taken();
      const referenced = withReference ? NAMES.flatMap(numbered).map((each) => `reference.${each}`) : [];
      const header = ["time", ...NAMES.flatMap(numbered), ...numbered("actuator_force"), ...referenced, ...numbered("flag.force_limited")];
      const lines = [header.join(",")], motion = [["time", ...numbered("position"), ...numbered("orientation")].join(",")], begun = values[0];
      for (let k = 0; k < rows; k++) {
        const row = values.subarray(k * size, (k + 1) * size), numbers = row.subarray(0, withReference ? 55 : 31), flags = row[55];
        lines.push(`${numbers.join(",")},${[0, 1, 2, 3, 4, 5].map((leg) => String(Boolean(flags & (1 << leg)))).join(",")}`);
        if (dragged) motion.push([Number((row[0] - begun).toFixed(9)), ...row.subarray(31, 37)].join(","));
        if (k % 4000 === 3999) await new Promise((resolve) => { setTimeout(resolve); });
      }
      const end = values[(rows - 1) * size], duration = Number((end - begun).toFixed(9)), text = await experiment(dragged, rows > 1 ? duration : 0, spans(faults, begun, duration), values);
      const metadata = { ...taken.metadata, rows, duration, plant_step: step, outcome: { status: "completed", time: end, cause: null } };
      return {
        "record.csv": `${lines.join("\n")}\n`, "metadata.json": `${JSON.stringify(metadata, null, 2)}\n`, "experiment.toml": text,
        ...Object.fromEntries(Object.entries(taken.files).map(([name, bytes]) => [name, Uint8Array.from(atob(bytes), (letter) => letter.charCodeAt(0))])),
        ...(dragged ? { "reference.csv": `${motion.join("\n")}\n` } : {}),
      };
    };
    const download = async () => {
      $("home-said").textContent = "writing …";
      try {
        const found = await files(), link = GS.element("a", { href: URL.createObjectURL(await archive(found)), download: `${taken.name}_live.zip` });
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 60000);
        $("home-said").textContent = `${link.download} has ${Object.keys(found).join(", ")}: unpack it, then gough-stewart run experiment.toml, or gs.read_record(folder)`;
      } catch (problem) {
        $("home-said").textContent = String(problem.message || problem);
      }
    };
    $("home").addEventListener("click", download);

    // All settings in the page's address.
    const state = () => ({ turn: turning.now, hand: hand.taken() || given.isOpen ? hand.wanted() : null, outside: outside().sliders, speed: $("speed").value });
    const link = () => `${location.href.split("#")[0]}#${encodeURIComponent(JSON.stringify(state()))}`;
    let later = null;
    const keep = () => {
      clearTimeout(later);
      later = setTimeout(() => history.replaceState(null, "", link()), 300);
    };
    $("link").addEventListener("click", async () => {
      const text = link();
      history.replaceState(null, "", text);
      try {
        await navigator.clipboard.writeText(text);
        $("home-said").textContent = "the link with all settings is in the clipboard";
      } catch {
        $("home-said").textContent = "the link with all settings is in the address bar";
      }
    });
    const numbers = (values, n) => Array.isArray(values) && values.length === n && values.every((value) => value === null || Number.isFinite(value));
    const restore = () => {
      if (location.hash.length < 2) return;
      try {
        const found = JSON.parse(decodeURIComponent(location.hash.slice(1)));
        if (numbers(found.turn, turn.names.length)) turning.to(found.turn);
        if (numbers(found.hand, 6)) hand.to(found.hand);
        for (const [id, value] of Object.entries(found.outside || {})) {
          if (!["payload", "tilt"].includes(id) || !Number.isFinite(value)) continue;
          $(id).value = value;
          $(id).dispatchEvent(new Event("input"));
        }
        if ([...$("speed").options].some((option) => option.value === found.speed)) $("speed").value = found.speed;
      } catch {
        $("home-said").textContent = "the link's settings cannot be read; the experiment's own are used";
      }
    };
    turning.onChange(keep);
    hand.onChange(keep);
    for (const id of ["payload", "tilt", "speed"]) $(id).addEventListener("input", keep);
    return { files, restore, link };
  };
})();
