// Makes message classes of asyncapi.yaml with AsyncAPI's modelina:
//
//     node protocol/generate.mjs typescript messages.ts     classes with marshal() and unmarshal(), one module
//     node protocol/generate.mjs javascript messages.mjs    the same, compiled
//     node protocol/generate.mjs python messages.py         pydantic models of D6.1's seven messages
import { realpathSync } from "node:fs";
import { writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";

import { Parser, fromFile } from "@asyncapi/parser";
import { PYTHON_PYDANTIC_PRESET, PythonGenerator, TS_COMMON_PRESET, TypeScriptGenerator } from "@asyncapi/modelina";
import ts from "typescript";

const DOCUMENT = fileURLToPath(new URL("asyncapi.yaml", import.meta.url));
const D61 = ["discovery", "server", "parameters", "control", "sensor", "actuator", "fitness"];
const PYTHON_HEAD = `from __future__ import annotations

from enum import Enum
from typing import Any, List, Optional, Union

from pydantic import BaseModel, Field, model_serializer, model_validator
`;

/** The models of a language, as modelina has them: name and text. */
export async function models(language) {
  const { document } = await fromFile(new Parser(), DOCUMENT).parse();
  const generator =
    language === "python"
      ? new PythonGenerator({ presets: [PYTHON_PYDANTIC_PRESET] })
      : new TypeScriptGenerator({
          modelType: "class",
          presets: [{ preset: TS_COMMON_PRESET, options: { marshalling: true } }],
        });
  return generator.generate(document);
}

/** The models and those that they name, down from some titles. */
function needed(all, titles) {
  const chosen = new Set(all.filter(({ modelName }) => titles.includes(modelName.toLowerCase())));
  for (const one of chosen) {
    for (const other of all) {
      if (other.modelName && new RegExp(`\\b${other.modelName}\\b`).test(one.result.replace(/'''[^]*?'''/g, ""))) {
        chosen.add(other);
      }
    }
  }
  return [...chosen];
}

/** One module with all classes. */
export async function generate(language) {
  const all = await models(language);
  if (language === "python") {
    // Classes of the extensions are left out: modelina writes what Python cannot read for text that is constant.
    const classes = needed(all, D61).map(({ result }) => result.trim());
    return `${[PYTHON_HEAD, ...classes].join("\n\n")}\n`;
  }
  const text = all.map(({ result }) => `export ${result.trim()}`).join("\n\n");
  if (language === "typescript") return `${text}\n`;
  const options = { target: ts.ScriptTarget.ES2022, module: ts.ModuleKind.ES2022 };
  return ts.transpileModule(text, { compilerOptions: options }).outputText;
}

if (process.argv[1] && realpathSync(process.argv[1]) === fileURLToPath(import.meta.url)) {
  const [language, file] = process.argv.slice(2);
  if (!["typescript", "javascript", "python"].includes(language) || file === undefined) {
    console.error("usage: node protocol/generate.mjs typescript|javascript|python FILE");
    process.exit(2);
  }
  await writeFile(file, await generate(language));
}
