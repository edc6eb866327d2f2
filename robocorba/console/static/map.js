export default {
  template: `<div class="console-empty">not written yet</div>`,
};
