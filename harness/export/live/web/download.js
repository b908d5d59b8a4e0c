"use strict";
// A session as an archive, and all settings as a link.
(() => {
  const GS = GoughStewart, { engine, tune, reference } = GS, { given } = engine, $ = (id) => document.getElementById(id), said = $("download-said");
  const TABLE = Array.from({ length: 256 }, (_, n) => { for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1; return n >>> 0; });
  const checksum = (bytes) => { let sum = 0xffffffff; for (const byte of bytes) sum = TABLE[(sum ^ byte) & 255] ^ (sum >>> 8); return (sum ^ 0xffffffff) >>> 0; };
  // Numbers of 2 or 4 bytes, as many as the letters H and I say.
  const words = (format, ...values) => {
    const view = new DataView(new ArrayBuffer([...format].reduce((size, letter) => size + (letter === "H" ? 2 : 4), 0)));
    let at = 0;
    [...format].forEach((letter, k) => {
      if (letter === "H") view.setUint16(at, values[k], true);
      else view.setUint32(at, values[k], true);
      at += letter === "H" ? 2 : 4;
    });
    return new Uint8Array(view.buffer);
  };
  // A ZIP archive of texts or bytes by name: the fields of PKWARE's appnote, 4.3.7, 4.3.12 and 4.3.16.
  const archive = async (files) => {
    const parts = [], directory = [];
    let at = 0;
    for (const [name, content] of Object.entries(files)) {
      const title = new TextEncoder().encode(name), raw = typeof content === "string" ? new TextEncoder().encode(content) : content;
      const packed = new Uint8Array(await new Response(new Blob([raw]).stream().pipeThrough(new CompressionStream("deflate-raw"))).arrayBuffer());
      const common = [20, 0x0800, 8, 0, 0x21, checksum(raw), packed.length, raw.length, title.length, 0];
      directory.push(words("IHHHHHHIIIHHHHHII", 0x02014b50, 20, ...common, 0, 0, 0, 0, at), title);
      for (const part of [words("IHHHHHIIIHH", 0x04034b50, ...common), title, packed]) { parts.push(part); at += part.length; }
    }
    const size = directory.reduce((sum, part) => sum + part.length, 0), n = Object.keys(files).length;
    return new Blob([...parts, ...directory, words("IHHHHIIH", 0x06054b50, 0, 0, n, n, size, at, 0)], { type: "application/zip" });
  };
  const download = async (ofCrash) => {
    said.textContent = "writing …";
    const { files } = await engine.ask("files", "written", { ofCrash });
    for (const [name, bytes] of Object.entries(given.download.files)) files[name] = Uint8Array.from(atob(bytes), (letter) => letter.charCodeAt(0));
    const link = GS.element("a", { href: URL.createObjectURL(await archive(files)), download: `${given.download.name}_live.zip` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    said.textContent = `${link.download} has ${Object.keys(files).join(", ")}: unpack it, then gough-stewart run experiment.toml, or gs.read_record(folder)`;
  };
  $("download").addEventListener("click", () => download(false));
  $("download-crash").addEventListener("click", () => download(true));

  // All settings in the page's address.
  const SLIDERS = ["payload", "tilt"];
  const link = () => {
    const outside = Object.fromEntries(SLIDERS.map((id) => [id, Number($(id).value)]));
    const settings = { tune: tune.now, reference: reference.wanted(), outside, speed: $("speed").value };
    return `${location.href.split("#")[0]}#${encodeURIComponent(JSON.stringify(settings))}`;
  };
  let later = null;
  const keep = () => {
    clearTimeout(later);
    later = setTimeout(() => history.replaceState(null, "", link()), 300);
  };
  $("link").addEventListener("click", async () => {
    history.replaceState(null, "", link());
    const isCopied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    said.textContent = `the link with all settings is in the ${isCopied ? "clipboard" : "address bar"}`;
  });
  const isList = (values, n) => Array.isArray(values) && values.length === n && values.every((value) => value === null || Number.isFinite(value));
  const restore = () => {
    if (location.hash.length < 2) return;
    try {
      const settings = JSON.parse(decodeURIComponent(location.hash.slice(1)));
      if (isList(settings.tune, tune.names.length)) tune.to(settings.tune);
      if (isList(settings.reference, 6)) reference.to(settings.reference);
      for (const id of SLIDERS) {
        if (!Number.isFinite(settings.outside?.[id])) continue;
        $(id).value = settings.outside[id];
        $(id).dispatchEvent(new Event("input"));
      }
      if ([...$("speed").options].some((option) => option.value === settings.speed)) $("speed").value = settings.speed;
    } catch {
      said.textContent = "the link's settings cannot be read; the experiment's own are used";
    }
  };
  for (const name of ["input", "change", "click", "pointerup", "keydown"]) $("main").addEventListener(name, keep);
  GS.download = { restore, link };
})();
