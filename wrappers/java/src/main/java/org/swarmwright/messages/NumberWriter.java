package org.swarmwright.messages;

import com.google.gson.TypeAdapter;
import com.google.gson.internal.LazilyParsedNumber;
import com.google.gson.stream.JsonReader;
import com.google.gson.stream.JsonWriter;
import java.io.IOException;
import java.util.function.DoubleFunction;

/** Writes numbers with a given conversion. */
final class NumberWriter extends TypeAdapter<Double> {
  private final DoubleFunction<String> decimals;

  NumberWriter(DoubleFunction<String> decimals) {
    this.decimals = decimals;
  }

  @Override
  public void write(JsonWriter out, Double value) throws IOException {
    if (value == null) {
      out.nullValue();
    } else if (Double.isFinite(value)) {
      out.value(new LazilyParsedNumber(decimals.apply(value)));
    } else {
      throw new MessageException(value + " cannot be sent: it is not a finite number");
    }
  }

  @Override
  public Double read(JsonReader in) throws IOException {
    return in.nextDouble();
  }
}
