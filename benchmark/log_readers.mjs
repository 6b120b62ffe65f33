// Copyright 2026 The linkage_vibration authors
// SPDX-License-Identifier: Apache-2.0
// Prints each message of an MCAP file as a line of JSON: topic, log time, publish time, fields.
// Run by log_readers.py: node log_readers.mjs FOLDER_WITH_NODE_MODULES FILE
import { open } from "node:fs/promises";
import { createRequire } from "node:module";

const [folder, path] = process.argv.slice(2);
const require = createRequire(`${folder}/package.json`);
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg2-serialization");

const plain = (_, value) => {
  if (typeof value === "bigint") return Number(value);
  if (ArrayBuffer.isView(value)) return Array.from(value);
  return Number.isNaN(value) ? "NaN" : value;
};

const file = await open(path);
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
for (const [id, channel] of reader.channelsById) {
  const schema = reader.schemasById.get(channel.schemaId);
  const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
  decoders.set(id, new MessageReader(definition));
}
for await (const { channelId, logTime, publishTime, data } of reader.readMessages({
  validateCrcs: true,
})) {
  const fields = decoders.get(channelId).readMessage(data);
  const { topic } = reader.channelsById.get(channelId);
  console.log(JSON.stringify([topic, `${logTime}`, `${publishTime}`, fields], plain));
}
await file.close();
