// Channels as a graph: nodes are channels, arrows are gateways with what they forward.
import { live } from "/static/live.js";
import { shortened } from "/static/texts.js";

const WIDTH = 400;
const NODE_PX = 30;
// Counters without news for this time are forgotten, such as those of clients that left [s].
const FORGOTTEN_S = 60;
// Distance of a text from its arrow.
const TEXT_PX = 14;

export default {
  template: `
    <section aria-label="Channels">
      <p v-if="!channels.length" class="panel-note">no channels; start some with: robocorba up --subnets a,b</p>
      <svg v-else class="channel-graph" :viewBox="'0 0 ${WIDTH} ' + height" role="group"
           aria-label="Channels and gateways">
        <defs>
          <marker id="gateway-end" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7"
                  orient="auto-start-reverse">
            <path d="M0,1 L9,5 L0,9" fill="none" stroke="currentColor" stroke-width="1.6" /></marker>
        </defs>
        <g v-for="link in links" :key="link.key"
           :class="['channel-link', { 'is-down': !link.isUp, 'is-chosen': chosen === link.key }]"
           tabindex="0" role="button" :aria-label="link.title" @click="chosen = link.key"
           @keydown.enter="chosen = link.key">
          <title>{{ link.title }}</title>
          <path class="channel-hit" :d="link.d" />
          <path :d="link.d" marker-end="url(#gateway-end)" />
          <text v-if="channels.length <= 8" :x="link.x" :y="link.y">{{ link.text }}</text>
        </g>
        <g v-for="node in channels" :key="node.name"
           :class="['channel-node', { 'is-down': node.problem, 'is-chosen': chosen === node.name }]"
           tabindex="0" role="button" :aria-label="'Channel ' + node.name" @click="chosen = node.name"
           @keydown.enter="chosen = node.name">
          <title>{{ node.name }}</title>
          <circle :cx="node.x" :cy="node.y" r="${NODE_PX}" />
          <text :x="node.x" :y="node.y - 4">{{ node.short }}</text>
          <text class="channel-rate" :x="node.x" :y="node.y + 11">{{ node.text }}</text>
        </g>
      </svg>
      <template v-if="detail">
        <h2 class="console-heading">{{ detail.title }}</h2>
        <dl class="console-facts">
          <template v-for="[name, value] in detail.facts" :key="name"><dt>{{ name }}</dt><dd>{{ value }}</dd></template>
        </dl>
        <table v-if="detail.proxies?.length" class="console-table">
          <thead><tr><th>Client</th><th>Role</th><th>Rate</th><th>Queue</th><th>Lost</th></tr></thead>
          <tbody><tr v-for="proxy in detail.proxies" :key="proxy.id" :title="proxy.title">
            <td>{{ proxy.name }}</td><td>{{ proxy.role }}</td><td>{{ proxy.rate }}</td><td>{{ proxy.queue }}</td>
              <td>{{ proxy.lost }}</td>
          </tr></tbody>
        </table>
      </template>
    </section>`,
  data() {
    return { channels: [], links: [], height: 260, chosen: "", detail: null };
  },
  mounted() {
    this.rates = new Rates();
    this.unlisten = live.listen((kind) => kind === "state" && this.update());
    this.update();
  },
  unmounted() {
    this.unlisten();
  },
  watch: {
    chosen: "describe",
  },
  methods: {
    update() {
      const rows = live.state?.channels ?? {};
      const names = Object.keys(rows).sort();
      const at = performance.now() / 1000;
      for (const name of names) {
        if (rows[name].state) this.rates.add(name, rows[name].state, at - (rows[name].age ?? 0));
      }
      this.height = names.length <= 2 ? 170 : Math.min(400, 220 + 20 * names.length);
      const places = circle(names, this.height);
      this.channels = names.map((name) => ({
        name, short: shortened(name, 8), ...places[name], problem: rows[name].problem,
        rate: this.rates.of(name, "in"), state: rows[name].state,
        text: rows[name].problem ? "no answer" : `${this.rates.of(name, "in").toFixed(0)}/s`,
      }));
      this.links = names.flatMap((name) => this.linksOf(name, rows[name], places));
      if (!this.chosen && names.length) [this.chosen] = names;
      this.describe();
    },
    // The gateways that supply other channels from this one.
    linksOf(name, row, places) {
      return (row.state?.links ?? []).filter((link) => link.direction === "OUTGOING").map((link) => {
        const key = `${name} \u2192 ${link.peer}`;
        const links = live.state.channels[link.peer]?.state?.links ?? [];
        const incoming = links.find((each) => each.direction === "INCOMING" && each.peer === name);
        const isUp = link.condition === "UP" && !row.problem;
        const rate = this.rates.of(name, `to ${link.peer}`);
        const lost = link.events.discarded + link.events.expired;
        const lag = isUp ? Math.max(link.lag, incoming?.lag ?? 0) : 0;
        const parts = isUp ? [`${rate.toFixed(rate < 10 ? 1 : 0)}/s`] : ["down"];
        if (link.events.queued) parts.push(`${link.events.queued} queued`);
        if (lag >= 0.0005) parts.push(`${(lag * 1000).toFixed(0)} ms`);
        if (lost) parts.push(`${lost} lost`);
        return { key, from: name, link, incoming, isUp, rate, lost, lag, text: parts.join(", "),
          title: `${key}: ${parts.join(", ")}`,
          ...arc(places[name], places[link.peer] ?? { x: WIDTH - 40, y: 30 }) };
      });
    },
    describe() {
      const link = this.links.find((each) => each.key === this.chosen);
      const node = this.channels.find((each) => each.name === this.chosen);
      if (link) this.detail = { title: `Gateway ${link.key}`, facts: linkFacts(link) };
      else this.detail = node ? this.channelDetail(node) : null;
    },
    channelDetail({ name, problem, state, rate }) {
      const facts = problem ? [["state", problem]] : [["state", "answers"]];
      if (!state) return { title: `Channel ${name}`, facts };
      const suppliers = state.proxies.filter((proxy) => proxy.kind.endsWith("CONSUMER"));
      const consumers = state.proxies.filter((proxy) => proxy.kind.endsWith("SUPPLIER"));
      const sum = (proxies, of) => proxies.reduce((total, proxy) => total + of(proxy.events), 0);
      facts.push(["events", `${rate.toFixed(1)} per second in, ${this.rates.of(name, "out").toFixed(1)} delivered`]);
      facts.push(["queued", sum(consumers, (events) => events.queued)]);
      const discarded = sum(consumers, (events) => events.discarded);
      facts.push(["lost", `${discarded} discarded, ${sum(consumers, (events) => events.expired)} expired`]);
      facts.push(["clients",
        `${suppliers.length} suppliers, ${consumers.length} consumers, ${state.evicted} disconnected for failures`]);
      facts.push(["federation", state.federation.join(", ")]);
      const proxies = state.proxies.map((proxy) => ({
        id: proxy.id, name: proxy.name || proxy.client || "in this process", title: subscription(proxy),
        role: (proxy.kind.endsWith("CONSUMER") ? "supplies" : "consumes")
          + (proxy.condition === "CONNECTED" ? "" : `, ${proxy.condition.toLowerCase()}`),
        rate: `${this.rates.of(name, `proxy ${proxy.id}`).toFixed(1)}/s`, queue: proxy.events.queued,
        lost: proxy.events.discarded + proxy.events.expired,
      }));
      return { title: `Channel ${name}`, facts, proxies };
    },
  },
};

// Events per second from growing counters, smoothed over a few reports.
class Rates {
  constructor() {
    this.known = new Map();
  }

  add(channel, state, at) {
    for (const [key, known] of this.known) if (at - known.at > FORGOTTEN_S) this.known.delete(key);
    const suppliers = state.proxies.filter((proxy) => proxy.kind.endsWith("CONSUMER"));
    const consumers = state.proxies.filter((proxy) => proxy.kind.endsWith("SUPPLIER"));
    this.count(channel, "in", suppliers.reduce((sum, proxy) => sum + proxy.events.received, 0), at);
    this.count(channel, "out", consumers.reduce((sum, proxy) => sum + proxy.events.delivered, 0), at);
    for (const proxy of state.proxies) this.count(channel, `proxy ${proxy.id}`, proxy.events.received, at);
    for (const link of state.links) {
      if (link.direction === "OUTGOING") this.count(channel, `to ${link.peer}`, link.events.delivered, at);
    }
  }

  count(channel, what, count, at) {
    const key = `${channel}\n${what}`;
    const before = this.known.get(key);
    if (before && at - before.at < 0.3) return;
    const isGrown = before && count >= before.count;
    const rate = isGrown ? (count - before.count) / (at - before.at) : 0;
    this.known.set(key, { count, at, rate: before ? 0.5 * before.rate + 0.5 * rate : 0 });
  }

  of(channel, what) {
    const rate = this.known.get(`${channel}\n${what}`)?.rate ?? 0;
    return rate < 0.05 ? 0 : rate;
  }
}

function linkFacts({ link, incoming, isUp, rate, lost, lag }) {
  const facts = [["state", [isUp ? "up" : "down", link.problem].filter(Boolean).join(": ")]];
  facts.push(["forwards", `${rate.toFixed(1)} events per second`], ["lag", `${(lag * 1000).toFixed(1)} ms`]);
  facts.push(["queued", link.events.queued],
    ["lost", `${lost}: ${link.events.discarded} discarded, ${link.events.expired} expired`]);
  facts.push(["repeated", incoming ? incoming.repeated : "unknown"], ["not wanted there", link.unseen]);
  facts.push(["reconnected", `${link.reconnects} times`],
    ["sent", `${(link.bytes / 1024).toFixed(1)} KiB in ${link.batches} batches`]);
  facts.push(["interest", link.interest.map((pattern) => pattern.type || "*").join(", ") || "none"]);
  return facts;
}

function subscription(proxy) {
  const clauses = proxy.subscribed.map((clause) => clause.patterns.map((pattern) => pattern.type || "*").join(" and "));
  return clauses.join(", ") || proxy.client;
}

// Places on a circle, two beside each other.
function circle(names, height) {
  const middle = [WIDTH / 2, height / 2];
  const radius = [WIDTH / 2 - NODE_PX - 30, height / 2 - NODE_PX - 14];
  return Object.fromEntries(names.map((name, index) => {
    if (names.length === 1) return [name, { x: middle[0], y: middle[1] }];
    const angle = Math.PI + (2 * Math.PI * index) / names.length;
    return [name, { x: middle[0] + radius[0] * Math.cos(angle), y: middle[1] + radius[1] * Math.sin(angle) }];
  }));
}

// A bent line between two nodes, and the middle of it for its text. The way back bends to the other side.
function arc(a, b) {
  const dx = b.x - a.x, dy = b.y - a.y;
  const length = Math.hypot(dx, dy) || 1;
  const bend = Math.min(46, length * 0.3);
  const mid = { x: (a.x + b.x) / 2 + (bend * dy) / length, y: (a.y + b.y) / 2 - (bend * dx) / length };
  const towards = (from) => {
    const far = Math.hypot(mid.x - from.x, mid.y - from.y) || 1;
    const share = (NODE_PX + 3) / far;
    return [from.x + (mid.x - from.x) * share, from.y + (mid.y - from.y) * share];
  };
  const [x0, y0] = towards(a);
  const [x1, y1] = towards(b);
  const text = {
    x: (a.x + b.x + 2 * mid.x) / 4 + (TEXT_PX * dy) / length, y: (a.y + b.y + 2 * mid.y) / 4 - (TEXT_PX * dx) / length,
  };
  return { d: `M${x0},${y0} Q${mid.x},${mid.y} ${x1},${y1}`, ...text };
}
