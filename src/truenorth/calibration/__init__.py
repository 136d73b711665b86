"""Where the antennas stand and which way things point: self-survey, theodolites, lever arms, boresight."""
