// Search for pages opened from the disk. Browsers refuse workers there, so the worker's script runs in a hidden frame,
// which a page may do: the frame has the page's own origin. From a server this file changes nothing.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.waiting = []
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      const start = () => {
        document.body.appendChild(this.frame)
        const inner = this.frame.contentWindow
        // What the script sends comes out of this object; what is sent to it comes as an event of its window.
        inner.postMessage = data => this.dispatchEvent(new MessageEvent("message", { data }))
        inner.importScripts = (...urls) => urls.reduce((before, each) => before.then(() => load(inner, each)), Promise.resolve())
        load(inner, url).then(() => {
          this.inner = inner
          this.waiting.splice(0).forEach(data => this.postMessage(data))
        })
      }
      if (document.body) start()
      else addEventListener("DOMContentLoaded", start)
    }

    postMessage(data) {
      if (this.inner) this.inner.dispatchEvent(new MessageEvent("message", { data }))
      else this.waiting.push(data)
    }

    terminate() {
      this.frame.remove()
    }
  }

  const load = (inner, url) => new Promise((done, failed) => {
    const script = inner.document.createElement("script")
    script.src = url
    script.onload = done
    script.onerror = () => failed(new Error(`cannot load ${url}`))
    inner.document.body.appendChild(script)
  })
}
