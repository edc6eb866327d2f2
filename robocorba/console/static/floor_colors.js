// The colours of floors, for light and dark pages.

// They are told apart without red and green (after Okabe and Ito).
export const COLORS = {
  light: {
    ground: "#ffffff", outside: "#eef0f2", grid: "#e3e6ea", wall: "#2b3036", object: "#8d96a0", movable: "#b5651d",
    door: "#0072b2", locked: "#b00068", area: "#5a6570", node: "#00674b", edge: "#58a58c", robot: "#0072b2",
    lost: "#9aa1a9", carried: "#e69f00", laser: "#d55e00", text: "#14181c", shaft: "#c9cfd6", cabin: "#e6b800",
    selected: "#d55e00", path: "#6a3d9a", reserved: "#cc79a7", collision: "#b00068", proximity: "#0e7c86",
    unmapped: "#c4007a",
  },
  dark: {
    ground: "#1a1e22", outside: "#101316", grid: "#262b31", wall: "#d8dde3", object: "#78828d", movable: "#d99152",
    door: "#56b4e9", locked: "#ff7ac6", area: "#9aa5b1", node: "#4fd1a5", edge: "#2f7d66", robot: "#56b4e9",
    lost: "#6b737c", carried: "#e69f00", laser: "#ff9d5c", text: "#eef1f4", shaft: "#3a4149", cabin: "#5c4d12",
    selected: "#ff9d5c", path: "#b79ae0", reserved: "#cc79a7", collision: "#ff7ac6", proximity: "#5fd0da",
    unmapped: "#ff5cc0",
  },
};

export function colorsNow() {
  return document.body.classList.contains("body--dark") ? COLORS.dark : COLORS.light;
}
