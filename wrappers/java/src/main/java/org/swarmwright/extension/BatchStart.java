package org.swarmwright.extension;

import com.google.gson.JsonObject;

/** Starts episodes that are stepped together (protocol/schemas/batch_start.schema.json). */
public final class BatchStart extends Request {
  /** Parameters; seed in them is replaced by each of the seeds. */
  public final JsonObject parameters;

  /** One seed per episode, at least one; the bits of unsigned numbers. */
  public final long[] seeds;

  BatchStart(MapReader map) {
    super(map);
    parameters = map.object("parameters");
    seeds = seeds(map);
  }
}
