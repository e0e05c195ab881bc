package org.swarmwright.messages;

/** A payload that is no message of this protocol; says what is wrong with it. */
public class MessageException extends IllegalArgumentException {
  private static final long serialVersionUID = 1L;

  /** Says what is wrong. */
  public MessageException(String reason) {
    super(reason);
  }
}
