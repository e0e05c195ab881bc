package org.swarmwright.extension;

/** Why a request is not served. */
public final class Refusal extends RuntimeException {
  private static final long serialVersionUID = 1L;

  /** For programs. */
  public enum Kind {
    /** Another tool has the server: another server, or a later request, may succeed. */
    TAKEN,
    /** The request cannot be served by this server. */
    INVALID,
    /** The request was accepted, but could not be finished. */
    FAILED
  }

  private final Kind kind;

  /** Makes a refusal; the reason is a text to be read. */
  public Refusal(Kind kind, String reason) {
    super(reason, null, false, false);
    this.kind = kind;
  }

  /** For programs. */
  public Kind kind() {
    return kind;
  }
}
