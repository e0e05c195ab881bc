package org.swarmwright.extension;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonNull;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.util.ArrayList;
import java.util.HashMap;
import java.util.List;
import java.util.Map;
import org.msgpack.core.MessageFormatException;
import org.msgpack.core.MessagePack;
import org.msgpack.core.MessagePackException;
import org.msgpack.core.MessageUnpacker;
import org.msgpack.value.ImmutableValue;
import org.msgpack.value.Value;
import org.msgpack.value.ValueFactory;
import org.swarmwright.messages.MessageException;

/** A MessagePack map with text keys, each with the type that it must have. */
public final class MapReader {
  /** The size limit of payloads; larger ones are refused without reading them. */
  public static final int MAX_BLOCK = 64 << 20;

  private static final int MAX_NESTING = 127;

  private final Map<String, Value> fields = new HashMap<>();

  private MapReader() {}

  /**
   * Reads a payload.
   *
   * @throws MessageException if it is too large or not such a map
   */
  public static MapReader of(byte[] payload) {
    if (payload.length > MAX_BLOCK) {
      throw new MessageException(
          payload.length + " bytes are more than the " + MAX_BLOCK + " of a block");
    }
    try (MessageUnpacker unpacker = MessagePack.newDefaultUnpacker(payload)) {
      MapReader map = new MapReader();
      int size = unpacker.unpackMapHeader();
      for (int i = 0; i < size; i++) {
        String key = unpacker.unpackString();
        map.fields.put(key, value(unpacker, payload.length));
      }
      return map;
    } catch (IOException
        | MessagePackException
        | IndexOutOfBoundsException
        | NegativeArraySizeException error) {
      throw new MessageException("not a valid MessagePack map: " + error.getMessage());
    }
  }

  /**
   * A value; binary whose length exceeds the payload is refused before memory is allocated for it.
   */
  private static ImmutableValue value(MessageUnpacker unpacker, int length) throws IOException {
    if (unpacker.getNextFormat().getValueType().isBinaryType()) {
      int promised = unpacker.unpackBinaryHeader();
      if (promised > length - unpacker.getTotalReadBytes()) {
        throw new MessageFormatException("the end is missing");
      }
      return ValueFactory.newBinary(unpacker.readPayload(promised), true);
    }
    return unpacker.unpackValue();
  }

  private Value get(String key) {
    Value value = fields.get(key);
    if (value == null) {
      throw new MessageException("\"" + key + "\" is missing");
    }
    return value;
  }

  private static MessageException wrong(String key, String expected) {
    return new MessageException("\"" + key + "\" is not " + expected);
  }

  /** A string. */
  public String text(String key) {
    if (!get(key).isStringValue()) {
      throw wrong(key, "a string");
    }
    try {
      return get(key).asStringValue().asString();
    } catch (MessagePackException error) {
      throw wrong(key, "a string in UTF-8");
    }
  }

  /** A string; null if the key is absent. */
  public String optionalText(String key) {
    return fields.containsKey(key) ? text(key) : null;
  }

  /** Strings; none if the key is absent. */
  public List<String> texts(String key) {
    if (!fields.containsKey(key)) {
      return List.of();
    }
    if (!get(key).isArrayValue()) {
      throw wrong(key, "a list of strings");
    }
    List<String> texts = new ArrayList<>();
    for (Value value : get(key).asArrayValue()) {
      if (!value.isStringValue()) {
        throw wrong(key, "a list of strings");
      }
      texts.add(value.asStringValue().asString());
    }
    return texts;
  }

  /** The bits of an integer from 0 to 2^64 - 1. */
  public long bits(String key) {
    boolean fits =
        get(key).isIntegerValue()
            && get(key).asIntegerValue().asBigInteger().signum() >= 0
            && get(key).asIntegerValue().asBigInteger().bitLength() <= 64;
    if (!fits) {
      throw wrong(key, "an integer from 0 to 2^64 - 1");
    }
    return get(key).asIntegerValue().asBigInteger().longValue();
  }

  /** An integer from 0 to max. */
  public long count(String key, long max) {
    long count = bits(key);
    if (count < 0 || count > max) {
      throw wrong(key, "an integer from 0 to " + max);
    }
    return count;
  }

  /** A finite number. */
  public double number(String key) {
    double number = get(key).isNumberValue() ? get(key).asNumberValue().toDouble() : Double.NaN;
    if (!Double.isFinite(number)) {
      throw wrong(key, "a finite number");
    }
    return number;
  }

  /** A map, as JSON. */
  public JsonObject object(String key) {
    if (!get(key).isMapValue()) {
      throw wrong(key, "a map");
    }
    return json(key, get(key), 1).getAsJsonObject();
  }

  /** Whether there is a map under a key; its content is not looked at. */
  public boolean hasMap(String key) {
    if (fields.containsKey(key) && !get(key).isMapValue()) {
      throw wrong(key, "a map");
    }
    return fields.containsKey(key);
  }

  private ByteBuffer numbers(String key, int size) {
    if (!get(key).isBinaryValue()) {
      throw wrong(key, "binary");
    }
    ByteBuffer bytes = get(key).asBinaryValue().asByteBuffer().order(ByteOrder.LITTLE_ENDIAN);
    if (bytes.remaining() % size != 0) {
      throw new MessageException(
          "\""
              + key
              + "\" has "
              + bytes.remaining()
              + " bytes, not a whole number of "
              + size
              + "-byte numbers");
    }
    return bytes;
  }

  /** Finite binary32 numbers. */
  public float[] singles(String key) {
    ByteBuffer bytes = numbers(key, Float.BYTES);
    float[] numbers = new float[bytes.remaining() / Float.BYTES];
    bytes.asFloatBuffer().get(numbers);
    for (int i = 0; i < numbers.length; i++) {
      if (!Float.isFinite(numbers[i])) {
        throw new MessageException("\"" + key + "\"[" + i + "] is NaN or infinite");
      }
    }
    return numbers;
  }

  /** The bits of 64-bit integers. */
  public long[] longs(String key) {
    ByteBuffer bytes = numbers(key, Long.BYTES);
    long[] numbers = new long[bytes.remaining() / Long.BYTES];
    bytes.asLongBuffer().get(numbers);
    return numbers;
  }

  private static JsonElement json(String key, Value value, int depth) {
    if (depth > MAX_NESTING) {
      throw wrong(key, "a map of at most " + MAX_NESTING + " levels");
    }
    switch (value.getValueType()) {
      case NIL:
        return JsonNull.INSTANCE;
      case BOOLEAN:
        return new JsonPrimitive(value.asBooleanValue().getBoolean());
      case INTEGER:
        return new JsonPrimitive(value.asIntegerValue().asBigInteger());
      case FLOAT:
        return new JsonPrimitive(finite(key, value.asFloatValue().toDouble()));
      case STRING:
        return new JsonPrimitive(value.asStringValue().asString());
      case ARRAY:
        JsonArray array = new JsonArray();
        value.asArrayValue().forEach(item -> array.add(json(key, item, depth + 1)));
        return array;
      case MAP:
        JsonObject object = new JsonObject();
        for (Map.Entry<Value, Value> entry : value.asMapValue().entrySet()) {
          if (!entry.getKey().isStringValue()) {
            throw wrong(key, "a map whose keys are strings");
          }
          object.add(
              entry.getKey().asStringValue().asString(), json(key, entry.getValue(), depth + 1));
        }
        return object;
      default:
        throw wrong(key, "a map of JSON values");
    }
  }

  private static double finite(String key, double number) {
    if (!Double.isFinite(number)) {
      throw wrong(key, "a map of finite numbers");
    }
    return number;
  }
}
