// What robots have seen and no map has: drawn with dashes, and a panel to accept or reject it.
import { fillPale, polygon } from "/static/canvas_shapes.js";
import { call } from "/static/live.js";

// Interval of asking for proposals [ms].
const INTERVAL_MS = 1000;

function seenBy({ seen_by, certainty }) {
  const names = seen_by.length > 1 ? `${seen_by.slice(0, -1).join(", ")} and ${seen_by.at(-1)}` : seen_by.join();
  return `seen by ${names}, ${certainty.toFixed(2)}`;
}

export class ProposalLayer {
  constructor() {
    this.proposals = [];
    this.chosen = "";
  }

  of(canvas) {
    return this.proposals.filter((each) => each.floor === canvas.plan?.name);
  }

  above(context, canvas) {
    context.strokeStyle = context.fillStyle = canvas.colors.selected;
    for (const { name, outline } of this.of(canvas)) {
      context.lineWidth = canvas.px(name === this.chosen ? 3 : 2);
      context.setLineDash([canvas.px(6), canvas.px(4)]);
      polygon(context, outline);
      fillPale(context, 0.12);
    }
    context.setLineDash([]);
  }

  labels(context, canvas) {
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "bottom";
    for (const proposal of this.of(canvas)) {
      const [px, py] = canvas.pixel(proposal.x, Math.max(...proposal.outline.map(([, y]) => y)));
      context.lineWidth = 3;
      context.strokeStyle = canvas.colors.ground;
      context.strokeText(seenBy(proposal), px, py - 4);
      context.fillStyle = canvas.colors.selected;
      context.fillText(seenBy(proposal), px, py - 4);
    }
  }
}

export const ProposalsPanel = {
  props: { proposals: Array, chosen: String },
  emits: ["show", "accept", "reject"],
  methods: { seenBy },
  template: `
    <div>
      <p v-if="!proposals.length" class="map-none">Robots have seen nothing that the map lacks.</p>
      <ul class="map-list">
        <li v-for="each in proposals" :key="each.name">
          <button :aria-pressed="each.name === chosen" @click="$emit('show', each)">
            <b>{{ each.name }}</b> <small>{{ each.floor }}</small><br>{{ seenBy(each) }}</button>
          <div class="console-actions map-line">
            <q-btn dense no-caps color="primary" icon="check" label="Accept" :aria-label="'Accept ' + each.name"
                title="Draws it on the map" @click="$emit('accept', each.name)" />
            <q-btn dense no-caps outline icon="close" label="Reject" :aria-label="'Reject ' + each.name"
                title="It is not proposed again while robots see it there" @click="$emit('reject', each.name)" />
          </div></li>
      </ul>
    </div>`,
};

export const proposalMethods = {
  // Ask for the proposals again and again while the page is open.
  async followProposals() {
    clearTimeout(this.proposalTimer);
    this.takeProposals(await call("map_proposals").catch(() => [])); // the page says why there is no answer
    if (!this.isClosed) this.proposalTimer = setTimeout(() => this.followProposals(), INTERVAL_MS);
  },
  takeProposals(found) {
    const isSame = JSON.stringify(found) === JSON.stringify(this.proposals);
    if (isSame) return;
    this.proposals = this.proposalLayer.proposals = found;
    this.canvas.redraw();
  },
  showProposal({ name, floor, x, y }) {
    this.chosenProposal = this.proposalLayer.chosen = name;
    if (floor !== this.current && this.floors.includes(floor)) this.show(floor);
    this.canvas.centreOn(x, y);
  },
  async acceptProposal(name) {
    this.takeAnswer(await this.saved(this.session.change("map_accept", { name })));
    this.followProposals();
  },
  async rejectProposal(name) {
    await call("map_reject", { name }).catch(({ message }) => this.say(message, true));
    this.followProposals();
  },
};
