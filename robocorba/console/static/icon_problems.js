// What an icon lacks before it can be checked: missing parameters, values out of range. Made from the schema.

const DEGREES = 180 / Math.PI;

// Parameters in radians are shown in degrees.
export function isAngle(parameter) {
  return (parameter.title ?? "").includes("rad");
}

// A bound or value as the form shows it.
export function shownNumber(parameter, value) {
  return Number((isAngle(parameter) ? value * DEGREES : value).toFixed(2));
}

// The unit of a number as the form has it, empty if it has none.
export function unitOf(parameter) {
  return ((parameter.title ?? "").match(/\[(.*)\]/)?.[1] ?? "").replace("rad", "\u00b0");
}

// The range of a number with its unit; empty if it has none. Bounds from `endless` on are none.
export function rangeText(parameter, endless = Infinity) {
  const { minimum, exclusiveMinimum, maximum } = parameter, least = minimum ?? exclusiveMinimum;
  const shown = (limit) => shownNumber(parameter, limit);
  const hasLeast = least > -endless, hasMost = maximum < endless; // false without such a bound
  const parts = [];
  if (hasLeast && hasMost && minimum !== undefined) parts.push(`${shown(least)} \u2026 ${shown(maximum)}`);
  else {
    if (hasLeast) parts.push(`${minimum === undefined ? "above" : "at least"} ${shown(least)}`);
    if (hasMost) parts.push(`at most ${shown(maximum)}`);
  }
  if (!parts.length) return "";
  const unit = unitOf(parameter);
  return `${parts.join(", ")}${unit.startsWith("\u00b0") ? unit : ` ${unit}`}`.trim();
}

// Problems of a node alone: [{kind: "incomplete" or "invalid", parameter, reason}].
export function missing(schema, node) {
  const found = [];
  const report = (parameter, reason, kind = "invalid") => found.push({ kind, parameter, reason });
  const definition = schema.icons.get(node.icon);
  collect(schema, definition, node.values, "", report);
  for (const [name, body] of Object.entries(node.bodies)) {
    if (!body.length && name !== "otherwise") report(name, "has no icons yet", "incomplete");
  }
  return found;
}

function collect(schema, definition, values, prefix, report) {
  const parameters = schema.parameters(definition);
  const known = new Set(parameters.map((parameter) => parameter.name));
  for (const name of Object.keys(values ?? {})) {
    if (!known.has(name) && name !== "when") report(prefix + name, "is unknown");
  }
  for (const parameter of parameters) {
    const value = values?.[parameter.name], name = prefix + parameter.name;
    const isEmpty = value === undefined || value === null || value === "";
    if (parameter.isCondition) {
      const chosen = schema.conditions.get(value?.when);
      if (chosen) collect(schema, chosen, value, `${name}.`, report);
      else report(name, "is missing", "incomplete");
    } else if (parameter.properties) {
      collect(schema, parameter, value, `${name}.`, report);
    } else if (isEmpty) {
      if (parameter.isRequired) report(name, "is missing", "incomplete");
    } else {
      checkValue(parameter, value, name, report);
    }
  }
}

function checkValue(parameter, value, name, report) {
  if (parameter.prefixItems) {
    parameter.prefixItems.forEach((item, index) => {
      const at = `${name}[${index}]`, angle = Array.isArray(value) ? value[index] : undefined;
      if (angle === undefined || angle === null) report(at, "is missing", "incomplete");
      else checkValue(item, angle, at, report);
    });
  } else if (parameter.enum) {
    if (!parameter.enum.includes(value)) report(name, `is not one of ${parameter.enum.join(", ")}`);
  } else if (parameter.type === "number" || parameter.type === "integer") {
    const reason = outOfRange(parameter, value);
    if (reason) report(name, reason);
  } else if (parameter.type === "string" && typeof value !== "string") {
    report(name, "is not a text");
  }
}

function outOfRange(parameter, value) {
  const { minimum, maximum, exclusiveMinimum } = parameter;
  if (typeof value !== "number" || !Number.isFinite(value)) return "is not a number";
  if (parameter.type === "integer" && !Number.isInteger(value)) return "is not a whole number";
  const isLow = value < minimum || value <= exclusiveMinimum; // false without such a bound
  return isLow || value > maximum ? `is out of range (${rangeText(parameter)})` : "";
}

// The name of a parameter as the form has it: joints[2] is the third of the joints.
export function spoken(parameter) {
  return parameter.replaceAll("_", " ").replace(/\[(\d+)\]/g, (_, index) => ` ${Number(index) + 1}`);
}

// Problems as lines of text, missing parameters in one: [{kind, text}].
export function problemLines(problems) {
  const lines = [];
  const lacking = problems.filter(({ kind, reason }) => kind === "incomplete" && reason === "is missing");
  const names = lacking.map(({ parameter }) => spoken(parameter.replace(/^.*\.|\[\d+\]$/g, "")));
  if (lacking.length) lines.push({ kind: "incomplete", text: `give ${[...new Set(names)].join(", ")}` });
  for (const problem of problems) {
    if (lacking.includes(problem)) continue;
    const { kind, parameter, reason } = problem;
    const isSentence = /^(is|has) /.test(reason);
    lines.push({ kind, text: parameter ? `${spoken(parameter)}${isSentence ? "" : ":"} ${reason}` : reason });
  }
  return lines;
}

// What concerns a field of the form: [{kind, reason}]. Checkers join parameters that are wrong in combination, such as
// "x, y, z": all of these fields are marked, and the last one has the reason.
export function reasonsAt(problems, name) {
  const found = [];
  for (const { kind, parameter, reason } of problems) {
    const names = parameter.split(", ");
    if (names.includes(name)) found.push({ kind, reason: names[names.length - 1] === name ? reason : "" });
  }
  return found;
}
