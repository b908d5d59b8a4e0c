"use strict";
// The theme wraps the button of every block of code in a landmark of its own; a reader of landmarks would hear of dozens.
new MutationObserver(() => {
  for (const nav of document.querySelectorAll("nav.md-code__nav:not([role])")) nav.setAttribute("role", "none");
}).observe(document.documentElement, { childList: true, subtree: true });
