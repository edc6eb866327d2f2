// Methods of the map page: findings of the checker, and paths by two clicks.
import { call } from "/static/live.js";
import { idOf } from "/static/map_model.js";

export const planningMethods = {
  // ---- findings ----

  async check(isWhole) {
    this.isChecking = true;
    this.refused = null;
    try {
      this.found = await call("map_check", { floor: isWhole ? "" : this.current, radius: this.radius });
      this.layer.findings = this.found.findings;
      this.chosenFinding = this.layer.finding = -1;
      this.canvas.redraw();
    } catch (error) {
      this.say(error.message, true);
    } finally {
      this.isChecking = false;
    }
  },
  async showFinding(n) {
    const finding = this.found.findings[n];
    this.chosenFinding = this.layer.finding = n;
    if (finding.floor !== this.current && this.floors.includes(finding.floor)) {
      this.show(finding.floor);
      await this.session.refresh(finding.floor);
    }
    this.canvas.centreOn(finding.x, finding.y);
    this.select([idOf(finding)]);
  },

  // ---- paths ----

  startPath() {
    this.clearPath();
    this.setTool("path");
  },
  clearPath() {
    this.paths = [];
    this.ends = [];
    this.showPaths();
  },
  addPathEnd([x, y]) {
    if (this.ends.length === 2) this.clearPath();
    this.ends.push({ floor: this.current, x, y });
    this.panel = "paths";
    this.showPaths();
    if (this.ends.length === 2) this.planPaths();
  },
  async planPaths() {
    this.isPlanning = true;
    const [start, goal] = this.ends;
    try {
      this.paths = await call("map_paths", { start, goal, radius: this.radius });
      const best = this.paths.find((path) => path.points);
      if (best) this.chosenPath = best.mode;
    } catch (error) {
      this.say(error.message, true);
    } finally {
      this.isPlanning = false;
    }
    this.showPaths();
  },
  choosePath(mode) {
    this.chosenPath = mode;
    this.showPaths();
  },
  showPaths() {
    this.layer.ends = this.ends.map((end) => ({ ...end }));
    const found = this.paths.filter((path) => path.points);
    this.layer.paths = found.map(({ mode, points }) => ({ mode, points, isChosen: mode === this.chosenPath }));
    this.canvas.redraw();
  },
};
