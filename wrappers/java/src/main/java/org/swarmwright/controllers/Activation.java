package org.swarmwright.controllers;

import java.util.Locale;

/** What a node does to the sum of its inputs. A NaN passes through every one of them. */
strictfp enum Activation {
  TANH {
    @Override
    float apply(float a) {
      return Functions.tanh(a);
    }
  },
  SIGMOID {
    @Override
    float apply(float a) {
      return Functions.sigmoid(a);
    }
  },
  RELU {
    @Override
    float apply(float a) {
      return a < 0f ? 0f : a;
    }
  },
  CLAMP {
    @Override
    float apply(float a) {
      float c = a < 0f ? 0f : a;
      return c > 1f ? 1f : c;
    }
  },
  LINEAR {
    @Override
    float apply(float a) {
      return a;
    }
  };

  abstract float apply(float a);

  /** The name in a specification. */
  String text() {
    return name().toLowerCase(Locale.ROOT);
  }
}
