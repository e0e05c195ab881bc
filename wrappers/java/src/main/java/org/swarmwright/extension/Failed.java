package org.swarmwright.extension;

/** A stepwise episode that has ended without fitness (protocol/schemas/failed.schema.json). */
public final class Failed {
  /** ID of the server. */
  public final long server;

  /** Of the control message that started the episode. */
  public final String simulationHash;

  /** What went wrong, for people. */
  public final String reason;

  /** Where in the simulation's code; null where that is not known. */
  public final String stack;

  /**
   * Whether the simulation refuses the parameters, so that no other attempt will go better here.
   */
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
