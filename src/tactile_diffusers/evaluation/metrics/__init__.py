"""Metrics: pure functions on arrays of textures, embeddings, latents and ratings.

| equation | where |
|---|---|
| RMSE, SNR, power difference (the paper's sections 3.1 and 3.2) | `errors.rmse`, `snr_db`, `power_difference` |
| spectral distance, goodness of fit | `errors.log_spectral_distance_db`, `errors.goodness_of_fit` |
| error of each band | `errors.signed_band_error_db`, `tactile_diffusers.signal.nine_band_error_db` |
| the 72 features that distances are measured in | `embedding.tactile_features` |
| the 34 features of four channels of touch | `afferents.afferent_features` |
| Fréchet distance (FTD) | `distances.frechet_tactile_distance` |
| kernel distance (KTD) | `distances.kernel_tactile_distance` |
| latent shift (section 3.3), d′ of a condition | `rating_effects.latent_shift_percent`, `rating_effects.d_prime` |
| copies of training segments | `copying.TrainingEnvelopes`, `copying.copied_share` |
| precision and recall, diversity | `diversity.precision_recall`, `diversity`, `rating_diversity` |
| intervals over surfaces | `statistics.jackknife` |
"""
