"""The paper's simulation: scenes, motions, noise, Monte-Carlo runs, and the definitions of its table and figure."""
