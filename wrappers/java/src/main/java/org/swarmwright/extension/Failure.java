package org.swarmwright.extension;

/** One episode that failed. */
public final class Failure {
  /** Index of the candidate in the request. */
  public final long candidate;

  /** Index of the seed in the request. */
  public final long episode;

  /** The error, as a text to be read. */
  public final String reason;

  /** Where in the simulation's code; null where that is not known. */
  public final String stack;

  /** One episode that failed. */
  public Failure(long candidate, long episode, String reason, String stack) {
    this.candidate = candidate;
    this.episode = episode;
    this.reason = reason;
    this.stack = stack;
  }
}
