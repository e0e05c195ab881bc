package org.swarmwright.mqtt;

import java.io.FilterInputStream;
import java.io.IOException;
import java.io.InputStream;
import java.net.Socket;
import jdk.net.ExtendedSocketOptions;

/**
 * A socket whose received data is acknowledged at once, if the system can do that (Linux).
 *
 * <p>A broker with Nagle's algorithm sends no more data before the acknowledgement, which the
 * system delays by 40 ms.
 */
final class AcknowledgingSocket extends Socket {
  private InputStream stream;

  @Override
  public synchronized InputStream getInputStream() throws IOException {
    if (stream == null) {
      InputStream plain = super.getInputStream();
      boolean able = supportedOptions().contains(ExtendedSocketOptions.TCP_QUICKACK);
      stream = able ? new Acknowledging(plain) : plain;
    }
    return stream;
  }

  private final class Acknowledging extends FilterInputStream {
    /** A buffer, since Paho reads a byte at a time. */
    private final byte[] buffer = new byte[8192];

    private int next;
    private int end;

    Acknowledging(InputStream stream) {
      super(stream);
    }

    @Override
    public int read() throws IOException {
      if (next == end && !fill()) {
        return -1;
      }
      return buffer[next++] & 0xff;
    }

    @Override
    public int read(byte[] bytes, int offset, int length) throws IOException {
      if (length == 0) {
        return 0;
      }
      if (next == end) {
        if (length >= buffer.length) {
          int count = super.in.read(bytes, offset, length);
          acknowledge(count);
          return count;
        }
        if (!fill()) {
          return -1;
        }
      }
      int count = Math.min(length, end - next);
      System.arraycopy(buffer, next, bytes, offset, count);
      next += count;
      return count;
    }

    @Override
    public int available() throws IOException {
      return end - next + super.in.available();
    }

    @Override
    public long skip(long count) throws IOException {
      for (long skipped = 0; skipped < count; skipped++) {
        if (read() < 0) {
          return skipped;
        }
      }
      return count;
    }

    @Override
    public boolean markSupported() {
      return false;
    }

    private boolean fill() throws IOException {
      int count = super.in.read(buffer, 0, buffer.length);
      acknowledge(count);
      next = 0;
      end = Math.max(count, 0);
      return end > 0;
    }

    private void acknowledge(int count) throws IOException {
      if (count > 0 && !isClosed()) {
        setOption(ExtendedSocketOptions.TCP_QUICKACK, true);
      }
    }
  }
}
