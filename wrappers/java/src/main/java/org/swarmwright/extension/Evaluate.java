package org.swarmwright.extension;

import com.google.gson.JsonObject;
import java.util.List;

/**
 * Request for offloaded evaluation: every candidate in every episode
 * (protocol/schemas/evaluate.schema.json).
 */
public final class Evaluate extends Request {
  /** Parameters; seed in them is replaced by each of the seeds. */
  public final JsonObject parameters;

  /** Controller specification without its weights. */
  public final JsonObject controller;

  /** (candidates, weights), row-major, finite. */
  public final float[] genomes;

  /** One seed per episode, at least one; the bits of unsigned numbers. */
  public final long[] seeds;

  /** Names of the metrics to return with the fitness. */
  public final List<String> metrics;

  /** 1 for the first try of this work. */
  public final long attempt;

  /** Seconds after which the tool gives the work to another server; 0 or less for never. */
  public final double lease;

  /** Whether the genomes are to be made from a sample, which this wrapper does not announce. */
  public final boolean isSample;

  Evaluate(MapReader map) {
    super(map);
    parameters = map.object("parameters");
    controller = map.object("controller");
    genomes = map.singles("genomes");
    seeds = seeds(map);
    metrics = map.texts("metrics");
    attempt = map.count("attempt", 0xFFFFFFFFL);
    lease = map.number("lease");
    isSample = map.hasMap("sample");
  }
}
