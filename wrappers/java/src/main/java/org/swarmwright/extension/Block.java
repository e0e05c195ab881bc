package org.swarmwright.extension;

import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.Arrays;

/** Numbers one behind the other, little-endian. */
public final class Block {
  private ByteBuffer bytes = ByteBuffer.allocate(64).order(ByteOrder.LITTLE_ENDIAN);

  private ByteBuffer room(int more) {
    if (bytes.remaining() < more) {
      ByteBuffer larger =
          ByteBuffer.allocate(2 * bytes.capacity() + more).order(ByteOrder.LITTLE_ENDIAN);
      bytes = larger.put(bytes.flip());
    }
    return bytes;
  }

  /** Appends an integer of 32 bits. */
  public void add(int number) {
    room(Integer.BYTES).putInt(number);
  }

  /** Appends a binary32. */
  public void add(float number) {
    room(Float.BYTES).putFloat(number);
  }

  /** Appends a binary64. */
  public void add(double number) {
    room(Double.BYTES).putDouble(number);
  }

  /** Number of bytes. */
  public int size() {
    return bytes.position();
  }

  /** Takes away what was appended behind so many bytes. */
  public void truncate(int size) {
    bytes.position(size);
  }

  byte[] bytes() {
    return Arrays.copyOf(bytes.array(), bytes.position());
  }
}
