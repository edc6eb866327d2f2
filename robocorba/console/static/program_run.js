// Follows a program that runs on a robot: which icons have been done, which one is running, and how it ended.
//
// Icons are followed by their identities in the page's program, so that it can be edited while it runs.

// Interval between requests for the progress [ms].
const POLL_MS = 250;

export class ProgramRun {
  // ask({robot, first}) gives the robot's progress; changed() is called after each news.
  constructor(ask, changed) {
    this.ask = ask;
    this.changed = changed;
    this.clear();
  }

  clear() {
    this.robot = "";
    this.ids = new Map();
    this.isFollowed = false;
    this.runningId = null;
    this.holderIds = new Set(); // of icons that hold the running one
    this.doneIds = new Set();
    this.failedId = null;
    this.report = null;
    this.condition = "";
    this.problem = "";
  }

  // Follow the robot's program. ids: identity of each icon by its path in the page's program. first: index of the icon
  // of the page that is the robot's first one. name: a program of another name is not followed.
  follow(robot, ids, first = 0, name = "") {
    this.clear();
    this.name = name;
    this.robot = robot;
    this.ids = ids;
    this.first = first;
    this.seen = 0;
    this.last = "";
    this.isFollowed = true;
    clearTimeout(this.timer);
    this.poll();
  }

  close() {
    this.isFollowed = false;
    clearTimeout(this.timer);
  }

  async poll() {
    const { robot, ids } = this; // an answer for what was followed before is ignored
    try {
      const news = await this.ask({ robot, first: this.seen });
      if (!this.isFollowed || ids !== this.ids) return;
      this.problem = "";
      this.take(news);
    } catch (error) {
      if (!this.isFollowed || ids !== this.ids) return;
      this.problem = error.message;
    }
    this.changed();
    if (this.isFollowed) this.timer = setTimeout(() => this.poll(), this.problem ? 4 * POLL_MS : POLL_MS);
  }

  take({ begun, report, condition }) {
    if (this.name && report.name !== this.name) return this.clear();
    this.condition = condition;
    if (this.report && report.seconds < this.report.seconds) {
      this.clear();
      this.problem = "another program was started on the robot";
      return;
    }
    this.report = report;
    for (const { number, icon } of begun) {
      this.begin(this.pagePath(icon));
      this.seen = number + 1;
    }
    if (report.result === "no_result") {
      const icon = report.icon ? this.pagePath(report.icon) : this.last;
      if (icon !== this.last) this.markDone(this.last, icon); // it waits before the next icon
      this.light(icon);
      return;
    }
    this.isFollowed = false;
    this.light("");
    if (report.result === "done") this.markDone(this.last, "");
    else this.failedId = this.id(this.pagePath(report.icon));
  }

  // An icon begins: the one before is done, and it and those after it are not, which matters when a repeat goes round.
  begin(path) {
    this.markDone(this.last, path);
    const [, list, index] = path.match(/^(.*)\[(\d+)\]$/);
    for (const [known, id] of this.ids) {
      if (!known.startsWith(`${list}[`)) continue;
      if (parseInt(known.slice(list.length + 1), 10) >= Number(index)) this.doneIds.delete(id);
    }
    this.last = path;
    this.light(path);
  }

  // The icon of a path and those that hold it are done, unless they hold the next one.
  markDone(path, next) {
    for (const done of [...holders(path), path]) {
      const id = this.id(done);
      if (id !== null && !next.startsWith(`${done}.`)) this.doneIds.add(id);
    }
  }

  light(path) {
    this.runningId = this.id(path);
    this.holderIds = new Set(holders(path).map((holder) => this.id(holder)));
  }

  id(path) {
    return this.ids.get(path) ?? null;
  }

  // The path in the page's program of an icon of the robot's program.
  pagePath(path) {
    return shiftedPaths(path, this.first);
  }
}

// A text whose paths of icons count from icon `first` of the program on: with paths that count from its begin.
export function shiftedPaths(text, first) {
  return text.replace(/(?<![.\w])icons\[(\d+)\]/g, (_, index) => `icons[${Number(index) + first}]`);
}

// Paths of the icons that hold the icon of a path, from outside.
function holders(path) {
  return [...path.matchAll(/\./g)].map((dot) => path.slice(0, dot.index));
}
