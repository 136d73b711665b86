"""The emulator: raw data of any antenna array and sensor suite, with the truth beside it."""
