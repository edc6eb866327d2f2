// A tab's session at the map editor: its edits, what it can undo, and the news of other editors.
import { keep, kept } from "/static/browser_store.js";
import { call } from "/static/live.js";
import { Elements } from "/static/map_model.js";

const AUTHOR = "robocorba-author";
// What a tab keeps of its session, so that it can undo its edits after it was at another page.
const KEPT = "robocorba-map-session";
const MAX_NEWS = 50;
// Versions that are known as one's own.
const MAX_OWN = 500;
// Pause before the next attempt when the server does not answer.
const RETRY_MS = 2000;
const ENDED = "the session of this page has ended";

export class MapSession {
  // changed(): called when elements, news or what can be undone have changed. say(text, isProblem): tell the user.
  constructor(changed, say) {
    // `whole`: the version after an edit of the whole building or its roads, which is outside the session.
    Object.assign(this, { changed, say, key: "", version: 0, undoable: "", redoable: "", news: [], floor: "",
      own: [], whole: 0 });
    this.author = localStorage.getItem(AUTHOR) || "operator";
    Object.assign(this, kept(KEPT));
    this.elements = new Elements();
    this.own = new Set(this.own);
    // The promise of the load that is under way, and whether it must load once more.
    this.loading = null;
    this.isWaiting = false;
    // The promise of a session that is being opened.
    this.opening = null;
    // Ends when all edits have been answered.
    this.changing = Promise.resolve();
  }

  open() {
    this.opening ??= this.openNew().finally(() => (this.opening = null));
    return this.opening;
  }

  async openNew() {
    const { session, version } = await call("map_open", { author: this.author });
    this.key = session;
    if (!this.version) this.version = version;
  }

  close() {
    if (!this.key) return;
    fetch("/call/map_close", {
      method: "POST", keepalive: true, headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ session: this.key }),
    }).catch(() => {}); // the server ends silent sessions by itself
    this.key = "";
  }

  // The page is left; the server ends sessions that stay silent.
  end() {
    this.isClosed = true;
    clearTimeout(this.timer);
  }

  keep() {
    const { key, version, whole, news } = this;
    keep(KEPT, { key, version, whole, news, own: [...this.own].slice(-MAX_OWN) });
  }

  async rename(author) {
    const wanted = author.trim().slice(0, 60) || "operator";
    if (wanted === this.author) return;
    const hadEdits = this.undoable || this.redoable;
    this.author = wanted;
    localStorage.setItem(AUTHOR, this.author);
    this.close();
    await this.refresh();
    if (hadEdits) this.say(`you are ${wanted} now; what you did under your former name can't be undone any more`);
  }

  // Load elements and news as they are now; calls while a load is under way share one more load after it.
  refresh(floor = this.floor) {
    this.floor = floor;
    this.isWaiting = true;
    this.loading ??= this.load();
    return this.loading;
  }

  async load() {
    try {
      while (this.isWaiting) {
        this.isWaiting = false;
        const wanted = this.floor;
        const [answer, news] = await Promise.all([
          call("map_floor", { floor: wanted }), this.inSession("map_news", () => ({ since: this.version })),
        ]);
        if (wanted === this.floor) this.elements = new Elements(wanted, answer);
        this.takeNews(news);
      }
      this.problem = "";
    } catch (error) {
      this.problem = error.message;
      clearTimeout(this.timer);
      if (!this.isClosed) this.timer = setTimeout(() => this.refresh(), RETRY_MS);
    } finally {
      this.loading = null;
    }
    this.changed();
  }

  // Call an operation of the session; a session that the console has ended, or forgot in a restart, is opened again.
  async inSession(operation, argument) {
    if (!this.key) await this.open();
    const { key } = this;
    try {
      return await call(operation, { session: key, ...argument() });
    } catch (error) {
      if (!error.message.startsWith(ENDED)) throw error;
      if (this.key === key) await this.open(); // else another call has opened one meanwhile
      return call(operation, { session: this.key, ...argument() });
    }
  }

  takeNews({ version, edits, undoable, redoable, note }) {
    Object.assign(this, { version, undoable, redoable });
    if (note) this.say(note);
    if (edits === null) this.say("the building has been replaced");
    for (const edit of edits ?? []) {
      const isOwn = this.own.has(edit.version);
      const text = `${isOwn ? "you" : edit.author || "somebody"}: ${edit.summary}`;
      this.news.unshift({ ...edit, isOwn, text });
      if (!isOwn) this.say(text);
    }
    this.news.length = Math.min(this.news.length, MAX_NEWS);
    this.keep();
  }

  // Make edits as one step. Returns the answer: {version} or {refused}; undefined if the server did not answer.
  edit(edits) {
    return this.change("map_edit", { edits });
  }

  undo() {
    const isWhole = this.whole && this.whole === this.version;
    return isWhole ? this.changeWhole("map_undo_whole", { version: this.whole }) : this.change("map_undo");
  }

  redo() {
    return this.change("map_redo");
  }

  // Make an edit, after those under way.
  change(operation, argument) {
    this.changing = this.changing.then(() => this.changeNow(operation, argument));
    return this.changing;
  }

  async changeNow(operation, argument = {}) {
    try {
      const answer = await this.inSession(operation, () => argument);
      if (answer.note) this.say(answer.note);
      if (answer.version) this.own.add(answer.version);
      await this.refresh();
      return answer;
    } catch (error) {
      this.say(error.message, true);
      await this.refresh();
      return undefined;
    }
  }

  // An edit outside the session, such as of the whole building. Returns whether it was made.
  async changeWhole(operation, argument) {
    try {
      const version = await call(operation, argument);
      this.own.add(version);
      this.whole = operation === "map_undo_whole" ? 0 : version;
      await this.refresh();
      return true;
    } catch (error) {
      this.say(error.message, true);
      return false;
    }
  }
}
