// The buttons beside a canvas that shows a floor: all of it, larger, smaller, and a page's own tools.
const VIEW = [
  ["fit_screen", "Show the whole floor", (canvas) => canvas.fit()], ["add", "Enlarge", (canvas) => canvas.zoom(1.4)],
  ["remove", "Reduce", (canvas) => canvas.zoom(1 / 1.4)],
];

export default {
  // canvas: returns the FloorCanvas. tools: {icon, title, isOn, isFirst, disable, press}; isFirst: of a group.
  props: { canvas: Function, tools: { type: Array, default: () => [] } },
  template: `
    <div class="console-tools" role="toolbar" aria-label="View">
      <q-btn v-for="[icon, title, press] in view" :key="icon" dense flat :icon="icon" :aria-label="title" :title="title"
             @click="press(canvas())" />
      <q-btn v-for="tool in tools" :key="tool.icon" dense flat :class="{ 'is-first': tool.isFirst }" :icon="tool.icon"
             :aria-label="tool.title" :aria-pressed="tool.isOn" :title="tool.title" :disable="tool.disable"
             @click="tool.press" />
    </div>`,
  data: () => ({ view: VIEW }),
};
