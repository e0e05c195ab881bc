package org.swarmwright.extension;

import com.google.gson.JsonObject;
import java.util.List;

/** Starts episodes that are stepped together (protocol/schemas/batch_start.schema.json). */
public final class BatchStart extends Request {
  /** Parameters; seed in them is replaced by each of the seeds. */
  public final JsonObject parameters;

  /** One seed per episode, at least one; the bits of unsigned numbers. */
  public final long[] seeds;

  /** Names of the metrics that are to come with the fitness. */
  public final List<String> metrics;

  BatchStart(MapReader map) {
    super(map);
    parameters = map.object("parameters");
    seeds = seeds(map);
    metrics = map.texts("metrics");
  }
}
