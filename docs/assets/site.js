"use strict";
// The theme wraps the button of every block of code in a landmark of its own; a reader of landmarks would hear of dozens.
new MutationObserver(() => {
  for (const nav of document.querySelectorAll("nav.md-code__nav:not([role])")) nav.setAttribute("role", "none");
}).observe(document.documentElement, { childList: true, subtree: true });

// Formulas and tables that scroll sideways can be scrolled by keys, too.
const scrolling = ".md-typeset .formula, .md-typeset__scrollwrap, .md-typeset pre > code";
const reachable = () => {
  for (const element of document.querySelectorAll(scrolling)) {
    if (element.scrollWidth > element.clientWidth) element.tabIndex = 0;
    else element.removeAttribute("tabindex");
  }
};
window.addEventListener("load", reachable);
window.addEventListener("resize", reachable);
