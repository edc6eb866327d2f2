// What the server tells of one robot beside the live floors: its path, and on demand the floor in its data pool.
import { Floor, readFrame } from "/static/floor_state.js";

const RECONNECT_MS = 1000;
// The server closes with this code what it will refuse again.
const REFUSED = 1008;

export class RobotLink {
  // changed(): something is new in `path`, `pool`, `floor`, `joints`, `problem`.
  constructor(robot, withPool, changed) {
    Object.assign(this, { robot, withPool, changed });
    this.path = [];
    this.connect();
  }

  connect() {
    // The pool as far as it is known: floor, lag [s]; and its content, as live.floor() has it.
    this.pool = null;
    this.floor = null;
    this.joints = new Map();
    this.problem = "";
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const query = `robot=${encodeURIComponent(this.robot)}&pool=${this.withPool ? "yes" : "no"}`;
    this.socket = new WebSocket(`${scheme}://${location.host}/robot-view?${query}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = (message) => this.receive(message.data);
    this.socket.onclose = ({ code, reason }) => {
      if (this.isClosed) return;
      this.path = [];
      if (code === REFUSED) this.problem = reason || "the console refuses this view: too many pages watch robots";
      else this.timer = setTimeout(() => this.connect(), RECONNECT_MS);
      this.changed();
    };
  }

  receive(data) {
    if (typeof data !== "string") {
      const { header, offset } = readFrame(data);
      if (this.floor?.name !== header.floor) this.floor = new Floor(header.floor);
      this.floor.apply(header, data, offset);
    } else {
      const news = JSON.parse(data);
      if (news.path) this.path = news.path;
      if (news.problem !== undefined) this.problem = news.problem;
      if (news.pool) {
        this.pool = { floor: news.pool.floor, lag: news.pool.lag };
        for (const [robot, joints] of Object.entries(news.pool.joints)) this.joints.set(robot, joints);
      }
    }
    this.changed();
  }

  close() {
    this.isClosed = true;
    clearTimeout(this.timer);
    this.socket.close();
  }
}
