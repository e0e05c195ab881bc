package org.swarmwright.extension;

import org.swarmwright.messages.MessageException;

/** What all requests have that are answered. */
public abstract class Request implements ToServer {
  /** Number chosen by the tool, 64 bits without sign; echoed in the answer. */
  public final long request;

  /** Who asks. */
  public final String tool;

  /** Topic for the answer, without prefix. */
  public final String reply;

  /** Title of the simulation. */
  public final String simulation;

  /** Which start of the server is meant; null where the tool does not say. */
  public final String instance;

  Request(MapReader map) {
    request = map.bits("request");
    tool = map.text("tool");
    reply = map.text("reply");
    simulation = map.text("simulation");
    instance = map.optionalText("instance");
  }

  static long[] seeds(MapReader map) {
    long[] seeds = map.longs("seeds");
    if (seeds.length == 0) {
      throw new MessageException("\"seeds\" is empty");
    }
    return seeds;
  }

  @Override
  public long request() {
    return request;
  }
}
