"""The true mean material of every part: what no method with one material a part can surpass."""
