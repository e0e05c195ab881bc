// Checks what the registries' tools can check of the contract: the AsyncAPI document with AsyncAPI's own parser (errors
// and warnings count, hints such as that there is a newer version do not) and bundler, what modelina generates of it, the schemas with ajv in
// strict mode, and the canonical JSON and the hashes with an implementation of RFC 8785 other than
// the one that the Python tests use. Exit status 1 if anything is wrong.
import { createHash } from "node:crypto";
import { readFile, readdir } from "node:fs/promises";
import { fileURLToPath } from "node:url";

import bundle from "@asyncapi/bundler";
import { Parser, fromFile } from "@asyncapi/parser";
import Ajv from "ajv/dist/2020.js";
import addFormats from "ajv-formats";
import canonicalize from "canonicalize";

import { models } from "./generate.mjs";

const here = (name) => fileURLToPath(new URL(name, import.meta.url));
const json = async (name) => JSON.parse(await readFile(here(name), "utf8"));
const problems = [];

const { document, diagnostics } = await fromFile(new Parser(), here("asyncapi.yaml")).parse();
for (const { severity, path, message, range } of diagnostics) {
  const level = ["error", "warning"][severity];
  if (level) problems.push(`asyncapi.yaml:${range.start.line + 1}: ${level}: ${path.join(".")}: ${message}`);
}

// One file without references to others, which is a sound document, too.
try {
  const { diagnostics: found } = await new Parser().parse((await bundle(here("asyncapi.yaml"))).json());
  for (const { severity, message } of found) if (severity === 0) problems.push(`asyncapi.yaml, bundled: ${message}`);
} catch (error) {
  problems.push(`asyncapi.yaml: cannot be bundled: ${error.message}`);
}

// Names that people can use, and for topics with several messages a union of all of them.
const found = await models("typescript");
for (const { modelName } of found) {
  if (/^Anonymous/.test(modelName)) problems.push(`asyncapi.yaml: a schema without title becomes ${modelName}`);
}
for (const channel of ["to_server", "to_tool"]) {
  const title = (name) => name.replace(/(^|_)(.)/g, (_, __, letter) => letter.toUpperCase());
  const union = found.find(({ modelName }) => modelName === title(channel))?.result ?? "";
  for (const message of document?.channels().get(channel).messages() ?? []) {
    const name = title(message.id());
    if (!new RegExp(`\\b${name}\\b`).test(union)) problems.push(`asyncapi.yaml: ${title(channel)} lacks ${name}`);
  }
}

const schemas = [];
for (const folder of ["schemas", "schemas/published"]) {
  const names = (await readdir(here(folder))).filter((name) => name.endsWith(".schema.json"));
  schemas.push(...names.map((name) => `${folder}/${name}`));
}
for (const name of schemas) {
  // D6.1 requires simulation where it does not define it.
  const ajv = addFormats(new Ajv({ strict: true, strictRequired: !name.includes("published") }));
  try {
    ajv.compile(await json(name));
  } catch (error) {
    problems.push(`${name}: ${error.message}`);
  }
}

const hashes = await json("vectors/hashes.json");
for (const { name, value, canonical, sha256 } of hashes) {
  const text = canonicalize(value);
  const digest = createHash("sha256").update(text, "utf8").digest("hex");
  if (text !== canonical) problems.push(`vectors/hashes.json: ${name}: canonical JSON is ${text}`);
  if (digest !== sha256) problems.push(`vectors/hashes.json: ${name}: SHA-256 is ${digest}`);
}

if (problems.length > 0 || document === undefined || hashes.length === 0 || schemas.length === 0) {
  console.error(problems.join("\n"));
  process.exit(1);
}
const counts = [document.channels(), document.operations(), document.messages()].map((all) => all.length);
console.log(
  `AsyncAPI ${document.version()}: ${counts[0]} channels, ${counts[1]} operations, ${counts[2]} messages; ` +
    `${found.length} models, ${schemas.length} schemas, ${hashes.length} hashes`,
);
