"use strict";
// Before anything is drawn, so that a dark page never flashes white. The switch itself is the report's script.
(() => {
  try {
    const theme = localStorage.getItem("cardiotwin-theme");
    if (theme) document.documentElement.dataset.theme = theme;
  } catch { /* a browser without storage follows the system */ }
})();
