// What pointer, keys and tools do on the monitor, and which robot they choose: methods of its component.

const PAN_PX = 60;

export const monitorHands = {
  // The tools beside the floor, but for those of each view.
  tools() {
    const toggle = (name, icon, title) => ({
      icon, title, isOn: this.shown[name], isFirst: name === "scans",
      press: () => {
        this.shown[name] = !this.shown[name];
        this.showLayers();
      },
    });
    const { rights: { administrator } } = this;
    return [
      { icon: "my_location", title: "Follow the selected robot (F)", isOn: this.isFollowing, press: () => this.follow() },
      toggle("scans", "sensors", "Lasers and proximity"),
      toggle("ways", "route", "Planned ways and reserved areas"),
      toggle("roads", "hub", "Nodes and edges"),
      {
        icon: "near_me", isFirst: true, isOn: this.places !== null, disable: !this.mayDrive,
        title: this.robot ? "Drive the selected robots here (D, or a right click)" : "Select a robot to drive it",
        press: () => this.startDrive(),
      },
      {
        icon: "gamepad", isOn: this.isJogging, disable: !this.mayJog, press: () => { this.isJogging = !this.isJogging; },
        title: this.mayJog ? "Drive the selected robot by hand (J)" : "Select a robot of this floor that runs no program",
      },
      {
        icon: "open_with", isOn: this.isMoving, disable: !administrator || !this.past.isLive,
        title: administrator ? "Drag robots and objects" : "Dragging needs a console with the rights of an administrator",
        press: () => { this.isMoving = !this.isMoving; },
      },
    ];
  },
  pick(isPicking) {
    this.isPicking = isPicking;
    if (!isPicking) this.picked = null;
  },
  // Begin to choose where the selected robot drives, or end it.
  startDrive() {
    this.isMoving = false;
    this.places = this.places || !this.mayDrive ? null : [];
  },
  driveTo([x, y]) {
    this.places = [...this.places ?? [], { floor: this.current, x, y }];
  },
  bodies() {
    return [...this.canvas.floor?.bodies.values() ?? []];
  },
  pointer(kind, event, point) {
    if (kind === "menu" && this.mayDrive) this.driveTo(point);
    if (this.drag.isActive) return this.drag.pointer(kind, point);
    if (kind !== "down") return false;
    if (this.isPicking) {
      this.picked = { floor: this.current, x: point[0], y: point[1] };
      this.isPicking = false;
      return true;
    }
    const body = this.canvas.bodyAt(point) ?? this.scene.lostAt(point);
    if (this.places && (!body || body.kind === "object")) {
      this.driveTo(point);
      return true;
    }
    if (!body) return false;
    if (body.kind !== "object") this.select(body.name, event.shiftKey);
    const mayMove = this.isMoving && this.past.isLive && body.number !== undefined;
    return mayMove && this.drag.begin(body, point, this.current);
  },
  key(event) {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey
      || target.closest("input, select, textarea, [contenteditable]")) return;
    const moves = { ArrowLeft: [PAN_PX, 0], ArrowRight: [-PAN_PX, 0], ArrowUp: [0, PAN_PX], ArrowDown: [0, -PAN_PX] };
    if (event.key === "Escape") this.escape();
    else if (this.drag.isActive && "qQ".includes(event.key)) this.drag.turn(1);
    else if (this.drag.isActive && "eE".includes(event.key)) this.drag.turn(-1);
    else if (moves[event.key] && [this.$refs.canvas, document.body].includes(target)) {
      this.canvas.pan(...moves[event.key]);
    }
    else if (event.key === "+" || event.key === "=") this.canvas.zoom(1.4);
    else if (event.key === "-") this.canvas.zoom(1 / 1.4);
    else if (event.key === "0") this.canvas.fit();
    else if (event.key === "f" || event.key === "F") this.follow();
    else if ((event.key === "j" || event.key === "J") && this.mayJog) this.isJogging = !this.isJogging;
    else if (event.key === "d" || event.key === "D") this.startDrive();
    else return;
    event.preventDefault();
  },
  // Ends one thing: a drag, picking, the tool, following, the selection.
  escape() {
    if (this.drag.isActive) this.drag.cancel();
    else if (this.isPicking) this.pick(false);
    else if (this.places) this.places = null;
    else if (this.isJogging) this.isJogging = false;
    else if (this.isMoving) this.isMoving = false;
    else if (this.isFollowing) this.isFollowing = false;
    else if (this.also.length) this.also = [];
    else this.selected = "";
  },
  // isMore: beside those that are selected, or no longer.
  select(name, isMore = false) {
    if (isMore && this.selected) {
      const others = this.also.filter((each) => each !== name);
      if (name !== this.selected) this.also = others.length < this.also.length ? others : [...others, name];
      return;
    }
    this.also = [];
    this.selected = name;
    const robot = this.robots.find((each) => each.name === name);
    if (this.past.isLive && robot?.floor && robot.floor !== this.current
      && this.floors.includes(robot.floor)) this.show(robot.floor);
  },
  // A row of the table was chosen: its robot comes to the middle of an enlarged floor.
  choose(name, isMore) {
    this.select(name, isMore);
    const body = this.canvas.floor?.body(name);
    if (body && !this.canvas.isFitted) this.canvas.centreOn(body.x, body.y);
  },
  follow() {
    this.isFollowing = !this.isFollowing;
    this.followBody();
  },
  followBody() {
    if (!this.isFollowing || !this.selected) return;
    const body = this.canvas.floor?.body(this.selected);
    if (body) this.canvas.centreOn(body.x, body.y);
  },
};
