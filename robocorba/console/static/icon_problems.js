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

// Problems of a node alone: [{kind: "incomplete", parameter, reason}].
export function missing(schema, node) {
  const found = [];
  const report = (parameter, reason) => found.push({ kind: "incomplete", parameter, reason });
  const definition = schema.icons.get(node.icon);
  collect(schema, definition, node.values, "", report);
  for (const [name, body] of Object.entries(node.bodies)) {
    if (!body.length && name !== "otherwise") report(name, "has no icons yet");
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
      else report(name, "is missing");
    } else if (parameter.properties) {
      collect(schema, parameter, value, `${name}.`, report);
    } else if (isEmpty) {
      if (parameter.isRequired) report(name, "is missing");
    } else {
      checkValue(parameter, value, name, report);
    }
  }
}

function checkValue(parameter, value, name, report) {
  if (parameter.prefixItems) {
    parameter.prefixItems.forEach((item, index) => {
      const at = `${name}[${index}]`, angle = Array.isArray(value) ? value[index] : undefined;
      if (angle === undefined || angle === null) report(at, "is missing");
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
  const bound = (limit) => `${shownNumber(parameter, limit)}${isAngle(parameter) ? "\u00b0" : ""}`;
  if (typeof value !== "number" || !Number.isFinite(value)) return "is not a number";
  if (parameter.type === "integer" && !Number.isInteger(value)) return "is not a whole number";
  if (minimum !== undefined && value < minimum) return `is less than ${bound(minimum)}`;
  if (exclusiveMinimum !== undefined && value <= exclusiveMinimum) return `is not more than ${bound(exclusiveMinimum)}`;
  if (maximum !== undefined && value > maximum) return `is more than ${bound(maximum)}`;
  return "";
}

// Problems as lines of text, missing parameters in one: [{kind, text}].
export function problemLines(problems) {
  const lines = [];
  const lacking = problems.filter(({ kind, reason }) => kind === "incomplete" && reason === "is missing");
  const names = lacking.map(({ parameter }) => parameter.replace(/^.*\.|\[\d+\]$/g, ""));
  if (lacking.length) lines.push({ kind: "incomplete", text: `give ${[...new Set(names)].join(", ")}` });
  for (const problem of problems) {
    if (lacking.includes(problem)) continue;
    const { kind, parameter, reason } = problem;
    const isSentence = kind === "incomplete";
    lines.push({ kind: isSentence ? "invalid" : kind, text: parameter ? `${parameter}${isSentence ? "" : ":"} ${reason}` : reason });
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
