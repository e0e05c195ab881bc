// Checks what the registries' tools can check of the contract: the AsyncAPI document with AsyncAPI's own parser (errors
// and warnings count, hints such as that there is a newer version do not), and the canonical JSON and the hashes with an implementation of RFC 8785 other than
// the one that the Python tests use. Exit status 1 if anything is wrong.
import { createHash } from "node:crypto";
import { readFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";

import { Parser, fromFile } from "@asyncapi/parser";
import canonicalize from "canonicalize";

const here = (name) => fileURLToPath(new URL(name, import.meta.url));
const problems = [];

const { document, diagnostics } = await fromFile(new Parser(), here("asyncapi.yaml")).parse();
for (const { severity, path, message, range } of diagnostics) {
  const level = ["error", "warning"][severity];
  if (level) problems.push(`asyncapi.yaml:${range.start.line + 1}: ${level}: ${path.join(".")}: ${message}`);
}

const hashes = JSON.parse(await readFile(here("vectors/hashes.json"), "utf8"));
for (const { name, value, canonical, sha256 } of hashes) {
  const text = canonicalize(value);
  const digest = createHash("sha256").update(text, "utf8").digest("hex");
  if (text !== canonical) problems.push(`vectors/hashes.json: ${name}: canonical JSON is ${text}`);
  if (digest !== sha256) problems.push(`vectors/hashes.json: ${name}: SHA-256 is ${digest}`);
}

if (problems.length > 0 || document === undefined || hashes.length === 0) {
  console.error(problems.join("\n"));
  process.exit(1);
}
const counts = [document.channels(), document.operations(), document.messages()].map((all) => all.length);
console.log(`AsyncAPI ${document.version()}: ${counts[0]} channels, ${counts[1]} operations, ${counts[2]} messages; ${hashes.length} hashes`);
