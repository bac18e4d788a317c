"""The DeepMind Control tasks (Tassa et al. 2018): one file a domain."""
