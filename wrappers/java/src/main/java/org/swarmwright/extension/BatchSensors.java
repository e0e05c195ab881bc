package org.swarmwright.extension;

import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;

/** The sensors of all agents that act next, and the episodes that have ended. */
public final class BatchSensors {
  /** The batch, an unsigned 64-bit integer. */
  public final long request;

  /** ID of the server. */
  public final long server;

  /** Counts the messages of a batch from 0. */
  public final long step;

  /** Index of the episode of each row, 32 bits. */
  public final Block episodes = new Block();

  /** Index of the agent of each row, 32 bits. */
  public final Block agents = new Block();

  /** (rows, sensors), row-major, binary32. */
  public final Block sensors = new Block();

  /** Indices of the episodes that have ended, 32 bits. */
  public final Block ended = new Block();

  /** Their fitness, binary64. */
  public final Block fitness = new Block();

  /** Their metrics that were asked for, by name, each of the shape of ended, binary64. */
  public final Map<String, Block> metrics = new TreeMap<>();

  /** Episodes that failed. */
  public final List<Failure> failed = new ArrayList<>();

  /** Why the batch is not served; null if it is served. */
  public final Refusal error;

  /** A message without rows. */
  public BatchSensors(long request, long server, long step, Refusal error) {
    this.request = request;
    this.server = server;
    this.step = step;
    this.error = error;
  }
}
