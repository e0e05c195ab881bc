package org.swarmwright.extension;

/** Why a request is not served. */
public final class Refusal extends RuntimeException {
  private static final long serialVersionUID = 1L;

  /** For programs. */
  public enum Kind {
    /** Another tool has the server: try another server, or later. */
    TAKEN,
    /** The request cannot be served by this server. */
    INVALID,
    /** It was begun or waited for in vain. */
    FAILED
  }

  private final Kind kind;

  /** The reason is for people. */
  public Refusal(Kind kind, String reason) {
    super(reason, null, false, false);
    this.kind = kind;
  }

  /** For programs. */
  public Kind kind() {
    return kind;
  }
}
