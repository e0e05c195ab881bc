package org.swarmwright.extension;

/** A stepwise episode that has ended without fitness (protocol/schemas/failed.schema.json). */
public final class Failed {
  /** ID of the server. */
  public final long server;

  /** Of the control message that started the episode. */
  public final String simulationHash;

  /** The error, as a text to be read. */
  public final String reason;

  /** Stack trace in the simulation's code; null if that is not known. */
  public final String stack;

  /** Whether the simulation refuses the parameters, so that another attempt fails, too. */
  public final boolean invalid;

  /** A stepwise episode that has ended without fitness. */
  public Failed(long server, String simulationHash, String reason, String stack, boolean invalid) {
    this.server = server;
    this.simulationHash = simulationHash;
    this.reason = reason;
    this.stack = stack;
    this.invalid = invalid;
  }
}
