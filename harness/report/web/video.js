"use strict";
// Records the animation once from start to end, with the browser's MediaRecorder.
(() => {
  const GS = GoughStewart;
  const KINDS = ["video/webm;codecs=vp8", "video/webm", "video/mp4"], WIDEST = 1280, RATE = 30, HOLD = 500;

  // The video format that this browser records; undefined if none.
  GS.videoKind = () => {
    const able = window.MediaRecorder && HTMLCanvasElement.prototype.captureStream;
    return able ? KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)) : undefined;
  };

  // Plays and records until the player stops, at the end or by the user; call `tick` at each frame.
  GS.video = (view, player, ended) => {
    const kind = GS.videoKind(), canvas = document.createElement("canvas"), parts = [];
    const wide = Math.min(WIDEST, view.canvas.clientWidth * Math.min(window.devicePixelRatio, 2));
    player.pause();
    player.seek(GS.state.start);
    GS.compose(view, canvas, wide, false);
    const recorder = new MediaRecorder(canvas.captureStream(RATE), { mimeType: kind, videoBitsPerSecond: 8e6 });
    recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
    recorder.addEventListener("stop", () => {
      GS.save(new Blob(parts, { type: kind }), kind.includes("mp4") ? ".mp4" : ".webm", document.getElementById("saved"));
      ended();
    });
    recorder.start();
    player.play();
    let endedAt = 0, stopped = false;
    return () => {
      if (stopped) return;
      GS.compose(view, canvas, wide, false);
      if (player.playing) return;
      // hold the last picture until a slow encoder has caught up
      endedAt ||= performance.now();
      stopped = performance.now() - endedAt > HOLD;
      if (stopped) recorder.stop();
    };
  };
})();
